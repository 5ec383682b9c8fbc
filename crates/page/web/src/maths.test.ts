// Run by node: `npm test`.
// @ts-nocheck: node's own modules have no types here.

import assert from "node:assert/strict";
import test from "node:test";
import { below125, entry, eulerStd, inside, magnification, positionRoot, spread, ticks, turn, withUncertainty } from "./maths.ts";

/** Upper triangle by rows of a 6×6. */
function upper(full) {
  return full.flatMap((row, i) => row.slice(i));
}

function euler(q) {
  // v_N = Rz Ry Rx v_B and N is W turned about X by 180 degrees.
  const x = turn(q, [1, 0, 0]);
  const y = turn(q, [0, 1, 0]);
  const z = turn(q, [0, 0, 1]);
  return [Math.atan2(-y[2], -z[2]), Math.asin(x[2]), Math.atan2(-x[1], x[0])];
}

function times([a, b, c, d], [e, f, g, h]) {
  return [
    a * e - b * f - c * g - d * h,
    a * f + b * e + c * h - d * g,
    a * g - b * h + c * e + d * f,
    a * h + b * g - c * f + d * e,
  ];
}

test("text near an edge is moved inwards, and what is outside is not", () => {
  assert.equal(inside(100, 20, 20, 300), 100);
  assert.equal(inside(5, 20, 20, 300), 20);
  assert.equal(inside(295, 0, 40, 300), 260);
  assert.equal(inside(-3, 20, 20, 300), -3);
  assert.equal(inside(10, 20, 400, 300), 20);
});

test("the triangle is read by rows", () => {
  const full = Array.from({ length: 6 }, (_, i) => Array.from({ length: 6 }, (_, j) => 10 * Math.min(i, j) + Math.max(i, j)));
  const packed = upper(full);
  assert.equal(packed.length, 21);
  for (let i = 0; i < 6; i++) for (let j = 0; j < 6; j++) assert.equal(entry(packed, i, j), full[i][j]);
});

test("standard deviations of the angles are those of many turned attitudes", () => {
  const attitude = times([0, 1, 0, 0], times([0.8, 0.1, -0.3, 0.5].map((x) => x / Math.hypot(0.8, 0.1, 0.3, 0.5)), [1, 0, 0, 0]));
  const root = [[2e-3, 0, 0], [1e-3, 1e-3, 0], [-5e-4, 4e-4, 3e-3]];
  const full = Array.from({ length: 6 }, () => Array(6).fill(0));
  for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) for (let k = 0; k < 3; k++) full[3 + i][3 + j] += root[i][k] * root[j][k];
  const centre = euler(attitude);
  // The unit vectors of the root as sigma points: their differences give the covariance exactly to first order.
  const variance = [0, 0, 0];
  for (let k = 0; k < 3; k++) {
    const moved = [1, -1].map((sign) => euler(times(attitude, [1, ...root.map((row) => (sign * row[k]) / 2)])));
    for (let i = 0; i < 3; i++) variance[i] += ((moved[0][i] - moved[1][i]) / 2) ** 2;
  }
  const got = eulerStd(upper(full), centre);
  for (let i = 0; i < 3; i++) assert.ok(Math.abs(got[i] / Math.sqrt(variance[i]) - 1) < 1e-3, `${got} ${variance.map(Math.sqrt)}`);
  assert.equal(eulerStd(upper(full), [0, Math.PI / 2, 0]), null);
});

test("the root's square is the covariance, and what is none has no root", () => {
  const p = [[4e-6, 1e-6, -5e-7], [1e-6, 9e-6, 2e-6], [-5e-7, 2e-6, 1e-6]];
  const full = Array.from({ length: 6 }, (_, i) => Array.from({ length: 6 }, (_, j) => p[i]?.[j] ?? 0));
  const columns = positionRoot(upper(full));
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      const square = columns.reduce((sum, column) => sum + column[i] * column[j], 0);
      assert.ok(Math.abs(square - p[i][j]) < 1e-18);
    }
  }
  full[2][2] = -1;
  assert.equal(positionRoot(upper(full)), null);
});

test("scales are round", () => {
  assert.deepEqual([0.001, 0.7, 1, 3, 49, 50, 999].map(below125), [0.001, 0.5, 1, 2, 20, 50, 500]);
  assert.equal(magnification(0.002, 0.15, 1), 100);
  assert.equal(magnification(0.0021, 0.15, 50), 50);
  assert.equal(magnification(3, 0.15, 1), 1);
  assert.equal(magnification(0, 0.15, 20), 20);
  assert.deepEqual(ticks(-0.1, 1.05, 5), [0, 0.5, 1]);
  assert.deepEqual(ticks(-7, 7, 4), [-5, 0, 5]);
});

test("numbers have the digits that they deserve", () => {
  assert.equal(withUncertainty(1.23456, 0.0021), "1.235 ± 0.002");
  assert.equal(withUncertainty(-12.3456, 0.5), "−12.3 ± 0.5");
  assert.equal(withUncertainty(-123.456, 30), "−123 ± 30");
  assert.equal(withUncertainty(0.00307, 7e-5), "0.00307 ± 0.00007");
  assert.equal(withUncertainty(-7.3e-4, 2e-5), "(−7.3 ± 0.2)e−4");
  assert.equal(withUncertainty(-0.2, 2), "0 ± 2");
  assert.equal(withUncertainty(0, 0), "0.000 ± 0.000");
});

test("names are moved apart and no further", () => {
  assert.deepEqual(spread([1, 30, 60], 14), [1, 30, 60]);
  assert.deepEqual(spread([10, 10, 10], 14), [-4, 10, 24]);
  assert.deepEqual(spread([], 14), []);
});
