// Strip charts: position, attitude and rates over the last seconds, each with a band of two standard deviations.

import { colours, label, prepare, type Surface } from "./canvas.ts";
import type { Flight } from "./flight.ts";
import { SPAN_S } from "./history.ts";
import { minus, ticks, withUncertainty } from "./maths.ts";

interface Strip {
  canvas: HTMLCanvasElement;
  legend: HTMLElement[];
  first: number;
  names: string[];
  leastSpan: number;
  /** A quantity with an axis of its own on the right, in degrees of the full circle: it would flatten the others. */
  apart: number | null;
  /** What the axis shows; it grows at once and shrinks slowly. */
  low: number;
  high: number;
}

const LEFT = 44;
const RIGHT = 46;
const BOTTOM = 16;
const TOP = 7;

export class Strips {
  private readonly strips: Strip[];
  private readonly flight: Flight;

  constructor(flight: Flight, root: HTMLElement) {
    this.flight = flight;
    const least = [0.2, 10, 20];
    this.strips = [...root.querySelectorAll<HTMLElement>("figure")].map((figure, k) => ({
      canvas: figure.querySelector("canvas") as HTMLCanvasElement,
      legend: [...figure.querySelectorAll<HTMLElement>("output")],
      first: 3 * k,
      names: [...figure.querySelectorAll<HTMLElement>("dt")].map((name) => name.textContent ?? ""),
      leastSpan: least[k] ?? 1,
      apart: k === 1 ? 2 : null,
      low: 0,
      high: 0,
    }));
  }

  draw(): void {
    for (const strip of this.strips) {
      const surface = prepare(strip.canvas);
      if (surface) this.drawStrip(strip, surface);
    }
  }

  /** Writes the newest values into the legends. */
  write(isLive: boolean): void {
    const { history } = this.flight;
    const newest = history.length - 1;
    for (const strip of this.strips) {
      strip.legend.forEach((output, i) => {
        const value = newest < 0 ? Number.NaN : history.value(newest, strip.first + i);
        const twice = newest < 0 ? Number.NaN : 2 * history.std(newest, strip.first + i);
        let text = "–";
        if (isLive && Number.isFinite(value)) {
          text = Number.isFinite(twice) ? withUncertainty(value, twice, 3) : minus(value.toFixed(2));
        }
        if (output.textContent !== text) output.textContent = text;
      });
    }
  }

  private drawStrip(strip: Strip, surface: Surface): void {
    const { history } = this.flight;
    const now_s = this.flight.now_s();
    const from = history.since(now_s - SPAN_S);
    const plot = { width: surface.width - LEFT - RIGHT, height: surface.height - BOTTOM - TOP };
    this.range(strip, from);
    const x = (t_s: number) => LEFT + ((t_s - now_s + SPAN_S) / SPAN_S) * plot.width;
    const y = (value: number, i: number) => {
      const [low, high] = i === strip.apart ? [-180, 180] : [strip.low, strip.high];
      return TOP + ((high - value) / (high - low)) * plot.height;
    };
    this.drawAxes(strip, surface, y);
    this.drawLosses(surface, from, x);
    const { pen } = surface;
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP - 2, plot.width + RIGHT, plot.height + 4);
    pen.clip();
    // More than one instant a pixel cannot be seen.
    const stride = Math.max(1, Math.floor((history.length - from) / plot.width));
    for (const draws of ["band", "line"] as const) {
      for (let i = 0; i < 3; i++) {
        for (const [begin, end] of this.runs(strip.first + i, from, stride)) {
          if (draws === "band") this.drawBand(strip, i, pen, begin, end, stride, x, y);
          else this.drawLine(strip, i, pen, begin, end, stride, x, y);
        }
      }
    }
    pen.restore();
    this.drawNames(strip, surface, y);
  }

  /** Bounds of the axis: what is shown with its bands, and a little more. */
  private range(strip: Strip, from: number): void {
    const { history } = this.flight;
    let [low, high] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
    for (let k = from; k < history.length; k++) {
      for (let i = 0; i < 3; i++) {
        const value = history.value(k, strip.first + i);
        if (!Number.isFinite(value) || i === strip.apart) continue;
        const twice = 2 * history.std(k, strip.first + i) || 0;
        low = Math.min(low, value - twice);
        high = Math.max(high, value + twice);
      }
    }
    if (low > high) [low, high] = [0, 0];
    const margin = Math.max(0.06 * (high - low), (strip.leastSpan - (high - low)) / 2);
    [low, high] = [low - margin, high + margin];
    const ease = 0.06;
    strip.low = strip.high > strip.low ? Math.min(low, strip.low + ease * (low - strip.low)) : low;
    strip.high = strip.high > strip.low ? Math.max(high, strip.high + ease * (high - strip.high)) : high;
  }

  private drawAxes(strip: Strip, { pen, width, height }: Surface, y: (value: number, i: number) => number): void {
    const { soft, line, series, font } = colours();
    pen.font = `11px ${font}`;
    pen.lineWidth = 1;
    pen.strokeStyle = line;
    pen.fillStyle = soft;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const marks = ticks(strip.low, strip.high, Math.max(2, Math.floor(height / 26)));
    const step = (marks[1] ?? 1) - (marks[0] ?? 0);
    const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    pen.beginPath();
    for (const mark of marks) {
      const at = Math.round(y(mark, -1)) + 0.5;
      pen.moveTo(LEFT, at);
      pen.lineTo(width - RIGHT, at);
      pen.fillText(minus((Math.abs(mark) < step / 1e3 ? 0 : mark).toFixed(digits)), LEFT - 6, at);
    }
    if (strip.apart !== null) {
      pen.fillStyle = series[strip.apart] ?? soft;
      pen.textAlign = "right";
      for (const mark of [-180, -90, 0, 90, 180]) pen.fillText(minus(String(mark)), width - 1, y(mark, strip.apart));
      pen.fillStyle = soft;
    }
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    for (let back = 0; back <= SPAN_S; back += 5) {
      const at = Math.round(width - RIGHT - (back / SPAN_S) * (width - LEFT - RIGHT)) + 0.5;
      pen.moveTo(at, TOP);
      pen.lineTo(at, height - BOTTOM);
      pen.fillText(back === 0 ? "now" : `−${back} s`, at, height);
    }
    pen.stroke();
  }

  /** Hatches the times at which no pose was measured. */
  private drawLosses({ pen, width, height }: Surface, from: number, x: (t_s: number) => number): void {
    const { history } = this.flight;
    const { gone } = colours();
    const least_s = this.flight.patience_ms() / 1000;
    const end_s = this.flight.now_s();
    let last = from > 0 ? history.time(from - 1) : Number.NaN;
    pen.strokeStyle = gone;
    pen.lineWidth = 1;
    const hatch = (begin_s: number, until_s: number) => {
      if (!(until_s - begin_s > least_s)) return;
      const [left, right] = [Math.max(LEFT, x(begin_s)), Math.min(width - RIGHT, x(until_s))];
      pen.save();
      pen.beginPath();
      pen.rect(left, TOP, right - left, height - BOTTOM - TOP);
      pen.clip();
      pen.beginPath();
      for (let at = left - (left % 8) - height; at < right; at += 8) {
        pen.moveTo(at, height - BOTTOM);
        pen.lineTo(at + height, -BOTTOM);
      }
      pen.stroke();
      pen.restore();
    };
    for (let k = from; k < history.length; k++) {
      if (!Number.isFinite(history.value(k, 0))) continue;
      hatch(last, history.time(k));
      last = history.time(k);
    }
    hatch(last, end_s);
  }

  /** Stretches of one quantity without a gap or a jump from 180° to -180°. */
  private *runs(quantity: number, from: number, stride: number): Generator<[number, number]> {
    const { history } = this.flight;
    const longest_s = (3 * stride * this.flight.interval_ms) / 1000;
    let begin = -1;
    let before = Number.NaN;
    for (let k = history.aligned(from, stride); k < history.length; k += stride) {
      const value = history.value(k, quantity);
      const breaks = !Number.isFinite(value) || (quantity >= 3 && quantity < 6 && Math.abs(value - before) > 180);
      const leaps = begin >= 0 && history.time(k) - history.time(k - stride) > longest_s;
      if (begin >= 0 && (breaks || leaps)) {
        yield [begin, k];
        begin = -1;
      }
      if (begin < 0 && Number.isFinite(value)) begin = k;
      before = value;
    }
    if (begin >= 0) yield [begin, history.length];
  }

  private drawBand(
    strip: Strip, i: number, pen: CanvasRenderingContext2D, begin: number, end: number, stride: number,
    x: (t_s: number) => number, y: (value: number, i: number) => number,
  ): void {
    const { history } = this.flight;
    const quantity = strip.first + i;
    const twice = (k: number) => 2 * history.std(k, quantity) || 0;
    pen.beginPath();
    let last = begin;
    for (let k = begin; k < end; k += stride) {
      pen.lineTo(x(history.time(k)), y(history.value(k, quantity) + twice(k), i));
      last = k;
    }
    for (let k = last; k >= begin; k -= stride) pen.lineTo(x(history.time(k)), y(history.value(k, quantity) - twice(k), i));
    pen.closePath();
    pen.globalAlpha = 0.28;
    pen.fillStyle = colours().series[i] ?? "";
    pen.fill();
    pen.globalAlpha = 1;
  }

  private drawLine(
    strip: Strip, i: number, pen: CanvasRenderingContext2D, begin: number, end: number, stride: number,
    x: (t_s: number) => number, y: (value: number, i: number) => number,
  ): void {
    const { history } = this.flight;
    pen.beginPath();
    for (let k = begin; k < end; k += stride) pen.lineTo(x(history.time(k)), y(history.value(k, strip.first + i), i));
    pen.strokeStyle = colours().series[i] ?? "";
    pen.lineWidth = 1.6;
    pen.lineJoin = "round";
    pen.stroke();
  }

  /** Names at the lines' ends, so that colour alone does not distinguish them. */
  private drawNames(strip: Strip, { pen, width }: Surface, y: (value: number, i: number) => number): void {
    const { history } = this.flight;
    const newest = history.length - 1;
    if (newest < 0) return;
    const { series, panel, font } = colours();
    pen.font = `italic 600 12px ${font}`;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    const ends = strip.names
      .map((name, i) => ({ name, i, at: y(history.value(newest, strip.first + i), i) }))
      .filter(({ at }) => Number.isFinite(at))
      .sort((a, b) => a.at - b.at);
    // Names that would lie on one another are moved apart.
    for (let k = 1; k < ends.length; k++) {
      const [above, under] = [ends[k - 1], ends[k]];
      if (above && under) under.at = Math.max(under.at, above.at + 12);
    }
    for (const { name, i, at } of ends) label(pen, name, width - RIGHT + 5, at, series[i] ?? "", panel);
  }
}
