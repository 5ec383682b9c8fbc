// Canvases that fit their place and the screen's pixels, and the page's colours for them.

import { inside } from "./maths.ts";

export interface Surface {
  pen: CanvasRenderingContext2D;
  width: number;
  height: number;
}

const surfaces = new WeakMap<HTMLCanvasElement, CanvasRenderingContext2D>();

/** The canvas, cleared, in CSS pixels; none while it has no place. */
export function prepare(canvas: HTMLCanvasElement): Surface | null {
  const pen = surfaces.get(canvas) ?? canvas.getContext("2d");
  if (!pen) return null;
  surfaces.set(canvas, pen);
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const { clientWidth: width, clientHeight: height } = canvas;
  if (width < 2 || height < 2) return null;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

/** Colours of the style sheet, as they are under the theme in use. */
export interface Palette {
  panel: string;
  ink: string;
  soft: string;
  line: string;
  series: [string, string, string];
  bad: string;
  accent: string;
  gone: string;
  floor: string;
  font: string;
}

let palette: Palette | null = null;

export function colours(): Palette {
  if (!palette) {
    const style = getComputedStyle(document.documentElement);
    const of = (name: string) => style.getPropertyValue(name).trim();
    palette = {
      panel: of("--panel"),
      ink: of("--ink"),
      soft: of("--soft"),
      line: of("--line"),
      series: [of("--series-1"), of("--series-2"), of("--series-3")],
      bad: of("--bad"),
      accent: of("--accent"),
      gone: of("--gone"),
      floor: of("--floor"),
      font: getComputedStyle(document.body).fontFamily,
    };
  }
  return palette;
}

/** To be called when the theme has changed. */
export function forgetColours(): void {
  palette = null;
}

/** Text with a rim in another colour, legible on any picture; what would be cut off at the left or right is moved inwards. */
export function label(pen: CanvasRenderingContext2D, text: string, at: number, y: number, fill: string, rim: string): void {
  const { actualBoundingBoxLeft, actualBoundingBoxRight } = pen.measureText(text);
  const x = inside(at, actualBoundingBoxLeft, actualBoundingBoxRight, pen.canvas.clientWidth);
  pen.lineJoin = "round";
  pen.lineWidth = 3;
  pen.strokeStyle = rim;
  pen.strokeText(text, x, y);
  pen.fillStyle = fill;
  pen.fillText(text, x, y);
}
