// The little mathematics that a picture of a flight needs.

import type { Quaternion, Vec3 } from "./events.ts";

export const DEG = 180 / Math.PI;

export function add(a: Vec3, b: Vec3): Vec3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function sub(a: Vec3, b: Vec3): Vec3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function scale(a: Vec3, by: number): Vec3 {
  return [a[0] * by, a[1] * by, a[2] * by];
}

export function norm(a: Vec3): number {
  return Math.hypot(a[0], a[1], a[2]);
}

/** A body vector in world axes. */
export function turn([w, x, y, z]: Quaternion, v: Vec3): Vec3 {
  const t: Vec3 = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [
    v[0] + w * t[0] + y * t[2] - z * t[1],
    v[1] + w * t[1] + z * t[0] - x * t[2],
    v[2] + w * t[2] + x * t[1] - y * t[0],
  ];
}

/** Where text at `x` that reaches so far to its left and right is whole between 0 and a width; as it is where `x` is outside. */
export function inside(x: number, left: number, right: number, width: number): number {
  return x < 0 || x > width ? x : Math.max(left, Math.min(x, width - right));
}

/** Entry of a 6×6 symmetric matrix that is given by rows of its upper triangle. */
export function entry(upper: readonly number[], row: number, column: number): number {
  const [i, j] = row <= column ? [row, column] : [column, row];
  return upper[i * 6 - (i * (i - 1)) / 2 + (j - i)] ?? Number.NaN;
}

/** Standard deviations of a position along the world's axes. */
export function positionStd(upper: readonly number[]): Vec3 {
  return [0, 1, 2].map((i) => Math.sqrt(entry(upper, i, i))) as Vec3;
}

/**
 * Standard deviations of roll, pitch and yaw, from the covariance of a small turn about body axes, by the kinematic equation of 3-2-1
 * angles (Stevens and Lewis, eq. 1.4-4). None where the nose points so steeply that roll and yaw cannot be distinguished.
 */
export function eulerStd(upper: readonly number[], euler: Vec3): Vec3 | null {
  const [phi, theta] = euler;
  const cosine = Math.cos(theta);
  if (Math.abs(cosine) < 1e-3) return null;
  const tangent = Math.tan(theta);
  const rows: Vec3[] = [
    [1, Math.sin(phi) * tangent, Math.cos(phi) * tangent],
    [0, Math.cos(phi), -Math.sin(phi)],
    [0, Math.sin(phi) / cosine, Math.cos(phi) / cosine],
  ];
  return rows.map((row) => {
    let variance = 0;
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j < 3; j++) variance += (row[i] ?? 0) * entry(upper, 3 + i, 3 + j) * (row[j] ?? 0);
    }
    return Math.sqrt(variance);
  }) as Vec3;
}

/**
 * Columns of the lower Cholesky factor of the position's covariance: centre + L u with |u| = k is the surface of k standard
 * deviations. None where the matrix is no covariance.
 */
export function positionRoot(upper: readonly number[]): [Vec3, Vec3, Vec3] | null {
  const p = (i: number, j: number) => entry(upper, i, j);
  const a = Math.sqrt(p(0, 0));
  const b = p(1, 0) / a;
  const c = p(2, 0) / a;
  const d = Math.sqrt(p(1, 1) - b * b);
  const e = (p(2, 1) - c * b) / d;
  const f = Math.sqrt(p(2, 2) - c * c - e * e);
  return [a, b, c, d, e, f].every(Number.isFinite) ? [[a, b, c], [0, d, e], [0, 0, f]] : null;
}

/** The largest of 1, 2, 5 times a power of ten that is not above a positive number. */
export function below125(x: number): number {
  const power = 10 ** Math.floor(Math.log10(x));
  const lead = x / power;
  // A hair of tolerance, as 10 ** -3 is not exact.
  return (lead >= 5 - 1e-9 ? 5 : lead >= 2 - 1e-9 ? 2 : 1) * power;
}

/**
 * A magnification out of 1, 2, 5, 10, ... under which `size` comes near `wanted`; the one in use is kept while it is within a factor
 * of two and a half, so that a scale does not flicker.
 */
export function magnification(size: number, wanted: number, inUse: number): number {
  if (!(size > 0)) return inUse;
  const shown = (size * inUse) / wanted;
  return shown > 0.4 && shown < 2.5 ? inUse : Math.max(1, below125((wanted / size) * 1.4));
}

/** Rising places, moved apart so that each is at least `least` from the next, about the same middle. */
export function spread(places: readonly number[], least: number): number[] {
  const out = [...places];
  for (let k = 1; k < out.length; k++) out[k] = Math.max(out[k] ?? 0, (out[k - 1] ?? 0) + least);
  const moved = out.reduce((sum, place, k) => sum + place - (places[k] ?? 0), 0) / Math.max(1, out.length);
  return out.map((place) => place - moved);
}

/** Some three to six round numbers between two bounds. */
export function ticks(low: number, high: number, most: number): number[] {
  const raw = (high - low) / most;
  let step = below125(raw);
  while ((high - low) / step > most) step = below125(step * 2.5);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => (first + k) * step);
}

/**
 * A number and its uncertainty, with so many digits as the first digit of the uncertainty bears; small and large numbers with a power
 * of ten that is common to both. `most` digits behind the point at most.
 */
export function withUncertainty(value: number, uncertainty: number, most = 7): string {
  const power = Math.floor(Math.log10(Math.max(Math.abs(value), uncertainty) || 1));
  if (power >= -3 && power < 5) {
    const digits = uncertainty > 0 ? Math.min(most, Math.max(0, Math.ceil(-Math.log10(uncertainty)))) : 3;
    const text = value.toFixed(digits);
    return minus(`${Number(text) === 0 ? text.replace("-", "") : text} ± ${uncertainty.toFixed(digits)}`);
  }
  const unit = 10 ** power;
  return `(${withUncertainty(value / unit, uncertainty / unit)})e${minus(String(power))}`;
}

export function minus(text: string): string {
  return text.replace("-", "−");
}
