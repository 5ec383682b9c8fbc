// The last seconds of the flight, as the strip charts draw them.

import type { Pose } from "./events.ts";
import { DEG, eulerStd, positionStd } from "./maths.ts";

/** Seconds that the charts show. */
export const SPAN_S = 20;
/** Rows that are kept: the span at 200 Hz. */
const CAPACITY = 4096;
/** Position (m), attitude (degrees), rates (degrees a second). */
export const QUANTITIES = 9;

/** A ring of instants, each with nine quantities and their standard deviations; what was not measured is NaN. */
export class History {
  private readonly t_s = new Float64Array(CAPACITY);
  private readonly values = new Float64Array(CAPACITY * QUANTITIES);
  private readonly stds = new Float64Array(CAPACITY * QUANTITIES);
  private count = 0;

  clear(): void {
    this.count = 0;
  }

  push(pose: Pose): void {
    // A replay that begins anew.
    if (this.length > 0 && pose.t_s <= this.time(this.length - 1)) this.clear();
    const row = this.count % CAPACITY;
    this.count += 1;
    this.t_s[row] = pose.t_s;
    const { euler_rad: euler, covariance } = pose;
    const attitude = euler && covariance ? eulerStd(covariance, euler) : null;
    const groups: [readonly number[] | null, readonly number[] | null, number][] = [
      [pose.position_m, covariance && positionStd(covariance), 1],
      [euler, attitude, DEG],
      [pose.rates_rad_s, pose.rates_std_rad_s, DEG],
    ];
    groups.forEach(([value, std, unit], group) => {
      for (let i = 0; i < 3; i++) {
        const at = row * QUANTITIES + group * 3 + i;
        this.values[at] = pose.valid && value ? (value[i] ?? Number.NaN) * unit : Number.NaN;
        this.stds[at] = pose.valid && std ? (std[i] ?? Number.NaN) * unit : Number.NaN;
      }
    });
  }

  get length(): number {
    return Math.min(this.count, CAPACITY);
  }

  /** The row of an index that counts from the oldest. */
  private row(index: number): number {
    return (this.count - this.length + index) % CAPACITY;
  }

  /** The first index from `index` on that is a multiple of `stride` since the flight began, so that the same instants are drawn each time. */
  aligned(index: number, stride: number): number {
    const rest = (this.count - this.length + index) % stride;
    return rest === 0 ? index : index + stride - rest;
  }

  time(index: number): number {
    return this.t_s[this.row(index)] ?? Number.NaN;
  }

  value(index: number, quantity: number): number {
    return this.values[this.row(index) * QUANTITIES + quantity] ?? Number.NaN;
  }

  std(index: number, quantity: number): number {
    return this.stds[this.row(index) * QUANTITIES + quantity] ?? Number.NaN;
  }

  /** The first index whose time is not before `t_s`. */
  since(t_s: number): number {
    let [low, high] = [0, this.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < t_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
