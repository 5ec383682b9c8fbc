// The cameras' pictures with what was seen in them, and how each camera does.

import { colours, label, prepare, type Surface } from "./canvas.ts";
import type { Camera, CameraState, Scene, DetectedBall } from "./events.ts";
import type { CameraNow, Flight } from "./flight.ts";
import { magnification, spread } from "./maths.ts";
import { element } from "./page.ts";

/** Signs beside the words, so that colour alone does not distinguish states. */
export const STATE_SIGNS: Record<CameraState, string> = {
  starting: "◌",
  running: "●",
  stalled: "▲",
  gone: "✕",
  moved: "⤢",
  frozen: "❚",
  dark: "◐",
};

/** A residual of usual length is drawn about so long. */
const ARROW_PX = 14;
/** From one name to the next below. */
const NAME_PX = 14;
/** A picture older than this is greyed. */
const PICTURE_OLD_MS = 600;

export class Cameras {
  private scene: Scene | null = null;
  private canvases: HTMLCanvasElement[] = [];
  private captions: HTMLElement[] = [];
  private magnified = 1;
  private usual_px = 0;
  private residuals = 0;
  private written: (Camera | null)[] = [];
  private readonly flight: Flight;
  private readonly pictures: HTMLElement;
  private readonly scaleNote: HTMLElement;
  private readonly table: HTMLTableElement;

  constructor(flight: Flight, pictures: HTMLElement, scaleNote: HTMLElement, table: HTMLTableElement) {
    this.flight = flight;
    this.pictures = pictures;
    this.scaleNote = scaleNote;
    this.table = table;
  }

  private lay(scene: Scene): void {
    this.scene = scene;
    this.written = [];
    this.canvases = [];
    this.captions = [];
    this.pictures.replaceChildren(...scene.cameras.map((camera) => {
      const canvas = element("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Picture of ${camera.name} with the markers seen in it`);
      const caption = element("figcaption");
      this.canvases.push(canvas);
      this.captions.push(caption);
      return element("figure", [canvas, caption]);
    }));
    this.pictures.dataset["count"] = String(scene.cameras.length);
  }

  draw(isAlive: boolean): void {
    const { scene } = this.flight;
    if (!scene) return;
    if (scene !== this.scene) this.lay(scene);
    this.flight.cameras.forEach((camera, k) => {
      const canvas = this.canvases[k];
      const surface = canvas && prepare(canvas);
      if (surface) this.drawPicture(scene, k, camera, surface, isAlive);
    });
  }

  private drawPicture(scene: Scene, k: number, camera: CameraNow, surface: Surface, isAlive: boolean): void {
    const view = scene.cameras[k];
    if (!view) return;
    const { pen, width, height } = surface;
    const zoom = Math.min(width / view.width_px, height / view.height_px);
    const [left, top] = [(width - zoom * view.width_px) / 2, (height - zoom * view.height_px) / 2];
    const age_ms = performance.now() - camera.image_ms;
    const isOld = !isAlive || age_ms > PICTURE_OLD_MS;
    pen.fillStyle = "#000";
    pen.fillRect(left, top, zoom * view.width_px, zoom * view.height_px);
    if (camera.image) {
      pen.filter = isOld ? "grayscale(1) brightness(0.6)" : "none";
      pen.drawImage(camera.image, left, top, zoom * view.width_px, zoom * view.height_px);
      pen.filter = "none";
    }
    const seen = isOld && camera.image ? [] : (this.flight.detectionsShown(camera)?.seen ?? []);
    // A pixel's coordinates are those of its centre.
    const at = (u: number, v: number): [number, number] => [left + (u + 0.5) * zoom, top + (v + 0.5) * zoom];
    const known = seen.filter((ball) => ball.marker !== null);
    const middle = at(mean(known.map((ball) => ball.u_px)), 0)[0];
    for (const ball of seen) this.drawBall(ball, pen, at, zoom);
    drawNames(pen, seen.map((ball) => {
      const [x, y] = at(ball.u_px, ball.v_px);
      const name = ball.marker === null ? "?" : (scene.markers[ball.marker]?.name ?? "?");
      return { x, y, name, radius: radiusOf(ball, zoom), isLeft: ball.marker !== null && x < middle };
    }));
    pen.font = `600 13px ${colours().font}`;
    pen.textAlign = "center";
    if (isOld && camera.image) label(pen, `picture ${(age_ms / 1000).toFixed(1)} s old`, width / 2, height / 2, "#fff", "#000");
    else if (!camera.image) label(pen, "no picture yet", width / 2, height / 2, "#fff", "#000");
  }

  private drawBall(
    ball: DetectedBall, pen: CanvasRenderingContext2D, at: (u: number, v: number) => [number, number], zoom: number,
  ): void {
    const [x, y] = at(ball.u_px, ball.v_px);
    const ring = (colour: string, width: number) => {
      pen.beginPath();
      pen.arc(x, y, radiusOf(ball, zoom), 0, 2 * Math.PI);
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.stroke();
    };
    pen.setLineDash(ball.marker !== null ? [] : [3, 3]);
    ring("#000", 3.5);
    ring(ball.marker !== null ? "#fff" : "#bbb", 1.5);
    pen.setLineDash([]);
    if (!ball.residual_px) return;
    const [du, dv] = ball.residual_px;
    const length = Math.hypot(du, dv);
    // The mean of all, later of some hundred.
    this.residuals += 1;
    this.usual_px += Math.max(0.01, 1 / this.residuals) * (length - this.usual_px);
    this.magnified = magnification(this.usual_px * zoom, ARROW_PX, this.magnified);
    drawArrow(pen, x, y, du * zoom * this.magnified, dv * zoom * this.magnified);
  }

  /** Fills in captions and table. */
  write(isAlive: boolean): void {
    const { scene } = this;
    if (!scene) return;
    this.scaleNote.textContent = this.usual_px > 0 ? `residuals ×${this.magnified}` : "";
    this.flight.cameras.forEach((camera, k) => {
      const caption = this.captions[k];
      const state = camera.state?.state ?? "starting";
      const word = isAlive ? `${STATE_SIGNS[state]} ${state}` : "no connection";
      if (caption) {
        caption.textContent = `${scene.cameras[k]?.name ?? ""} ${word}`;
        caption.dataset["well"] = String(isAlive && state === "running");
      }
    });
    const states = this.flight.cameras.map((camera) => camera.state);
    if (states.length === this.written.length && states.every((state, k) => state === this.written[k])) return;
    this.written = states;
    this.table.tBodies[0]?.replaceChildren(...this.flight.cameras.flatMap((camera, k) => this.rows(scene, camera, k)));
  }

  private rows(scene: Scene, camera: CameraNow, k: number): HTMLTableRowElement[] {
    const now = camera.state;
    const name = element("th", scene.cameras[k]?.name ?? "");
    name.scope = "row";
    const state = element("td", now ? `${STATE_SIGNS[now.state]} ${now.state}` : "◌ starting");
    state.className = !now || now.state === "running" || now.state === "starting" ? "" : "bad";
    const numbers = now
      ? [now.rate_hz.toFixed(1), now.latency_ms.toFixed(1), String(now.missing), String(now.dropped)]
      : ["–", "–", "–", "–"];
    const first = element("tr", [name, state, ...numbers.map((text) => element("td", text))]);
    const shares = scene.markers.map((marker, m) => share(marker.name, marker.rgb, now?.markers[m]));
    const wide = element("td", now?.reason && now.state !== "running" ? [element("p", now.reason), ...shares] : shares);
    wide.colSpan = 6;
    wide.className = "shares";
    return [first, element("tr", [wide])];
  }
}

interface Name {
  x: number;
  y: number;
  name: string;
  radius: number;
  isLeft: boolean;
}

/** Names stand on either side of the body one below the other, where they lie on none of its balls nor on each other. */
function drawNames(pen: CanvasRenderingContext2D, names: readonly Name[]): void {
  pen.font = `600 12px ${colours().font}`;
  pen.textBaseline = "middle";
  for (const isLeft of [true, false]) {
    const own = names.filter((name) => name.isLeft === isLeft).sort((a, b) => a.y - b.y);
    const heights = spread(own.map((name) => name.y), NAME_PX);
    const edges = own.map((name) => (isLeft ? name.x - name.radius : name.x + name.radius));
    const aside = isLeft ? Math.min(...edges) - 10 : Math.max(...edges) + 10;
    pen.textAlign = isLeft ? "right" : "left";
    own.forEach((name, k) => {
      const height = heights[k] ?? name.y;
      const [dx, dy] = [aside - name.x, height - name.y];
      const share = name.radius / Math.max(1, Math.hypot(dx, dy));
      for (const [colour, width] of [["#000", 3], ["#fff", 1]] as const) {
        pen.beginPath();
        pen.moveTo(name.x + share * dx, name.y + share * dy);
        pen.lineTo(aside, height);
        pen.strokeStyle = colour;
        pen.lineWidth = width;
        pen.stroke();
      }
      label(pen, name.name, aside + (isLeft ? -3 : 3), height, "#fff", "#000");
    });
  }
}

function radiusOf(ball: DetectedBall, zoom: number): number {
  return Math.max(4, (ball.diameter_px * zoom) / 2 + 4);
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / Math.max(1, values.length);
}

/** In how many of the last second's frames a marker was seen. */
function share(name: string, rgb: readonly number[], seen: number | undefined): HTMLElement {
  const dot = element("i");
  dot.style.background = `rgb(${rgb.join(",")})`;
  const isFew = seen !== undefined && seen < 0.9;
  const text = seen === undefined ? "–" : `${Math.round(100 * seen)} %${isFew ? " ▼" : ""}`;
  const chip = element("span", [dot, `${name} ${text}`]);
  chip.className = isFew ? "share few" : "share";
  chip.title = `${name}: seen in ${text} of the last second's frames`;
  return chip;
}

function drawArrow(pen: CanvasRenderingContext2D, x: number, y: number, dx: number, dy: number): void {
  const length = Math.hypot(dx, dy);
  if (length < 1) return;
  const [ux, uy] = [dx / length, dy / length];
  const head = Math.min(5, length / 2);
  const draw = (colour: string, width: number) => {
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(x + dx, y + dy);
    pen.moveTo(x + dx - head * (ux + 0.6 * uy), y + dy - head * (uy - 0.6 * ux));
    pen.lineTo(x + dx, y + dy);
    pen.lineTo(x + dx - head * (ux - 0.6 * uy), y + dy - head * (uy + 0.6 * ux));
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
  };
  draw("#000", 3.5);
  draw("#f0e442", 1.8);
}
