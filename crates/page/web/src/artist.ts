// Lines, areas and ellipsoids in world coordinates, on a canvas.

import type { Surface } from "./canvas.ts";
import type { Vec3 } from "./events.ts";
import { add, scale } from "./maths.ts";

/** A place on the screen and its depth; none behind the eye. */
export interface Spot {
  x: number;
  y: number;
  depth: number;
}

/** Draws in world coordinates. */
export class Artist {
  readonly pen: CanvasRenderingContext2D;
  readonly project: (point: Vec3) => Spot | null;
  readonly focal: number;

  constructor(surface: Surface, project: (point: Vec3) => Spot | null, focal: number) {
    this.pen = surface.pen;
    this.project = project;
    this.focal = focal;
  }

  line(points: readonly Vec3[], colour: string, width: number): void {
    this.pen.beginPath();
    let draws = false;
    for (const point of points) {
      const spot = this.project(point);
      if (spot && draws) this.pen.lineTo(spot.x, spot.y);
      else if (spot) this.pen.moveTo(spot.x, spot.y);
      draws = spot !== null;
    }
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = width;
    this.pen.stroke();
  }

  fill(points: readonly Vec3[], colour: string, alpha: number): void {
    const spots = points.map((point) => this.project(point));
    if (spots.some((spot) => !spot)) return;
    const { pen } = this;
    pen.beginPath();
    for (const spot of spots) if (spot) pen.lineTo(spot.x, spot.y);
    pen.closePath();
    const before = pen.globalAlpha;
    pen.globalAlpha = before * alpha;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = before;
  }

  /** The ellipse centre + a cos + b sin. */
  circle(centre: Vec3, a: Vec3, b: Vec3, colour: string, width: number): void {
    const points = Array.from({ length: 33 }, (_, k): Vec3 => {
      const angle = (k / 32) * 2 * Math.PI;
      return add(centre, add(scale(a, Math.cos(angle)), scale(b, Math.sin(angle))));
    });
    this.line(points, colour, width);
  }

  /** The outline of the ellipsoid with three conjugate half axes, filled; as from afar, which small ones are. */
  silhouette(centre: Vec3, axes: readonly Vec3[], colour: string): void {
    const middle = this.project(centre);
    if (!middle) return;
    let [xx, xy, yy] = [0, 0, 0];
    for (const axis of axes) {
      const end = this.project(add(centre, axis));
      if (!end) return;
      const [dx, dy] = [end.x - middle.x, end.y - middle.y];
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
    }
    const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
    const { pen } = this;
    pen.beginPath();
    const [long, short] = [Math.sqrt(mean + half), Math.sqrt(Math.max(0, mean - half))];
    pen.ellipse(middle.x, middle.y, long, short, Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
    pen.globalAlpha = 0.3;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }
}
