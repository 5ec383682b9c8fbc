// The room in three dimensions: cameras, the vehicle with its axes and markers, its path, and how well it is known.
//
// A few hundred lines and discs, which a plain canvas draws sharply; a library for scenes would be ten times the page.

import { Artist, type Spot } from "./artist.ts";
import { colours, label, prepare } from "./canvas.ts";
import type { CameraView, Scene, Vec3 } from "./events.ts";
import type { Flight } from "./flight.ts";
import { add, magnification, norm, positionRoot, scale, sub, turn } from "./maths.ts";

const FIELD = 0.9;
const FRUSTUM_M = 0.55;

export class Room {
  private azimuth = 0;
  private elevation = 0.42;
  private distance = 8;
  private target: Vec3 = [0, 0, 1];
  follows = false;
  private magnified = 1;
  private scene: Scene | null = null;
  private readonly flight: Flight;
  private readonly canvas: HTMLCanvasElement;
  private readonly caption: HTMLElement;

  constructor(flight: Flight, canvas: HTMLCanvasElement, caption: HTMLElement) {
    this.flight = flight;
    this.canvas = canvas;
    this.caption = caption;
    this.listen();
  }

  /** Puts all of the room into view. */
  reset(): void {
    const { scene } = this;
    this.elevation = 0.42;
    this.follows = false;
    if (!scene) return;
    const [from, to] = scene.volume_m;
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k): Vec3 => [
      (k & 1 ? to : from)[0], (k & 2 ? to : from)[1], (k & 4 ? to : from)[2],
    ]);
    const points = [...corners, ...scene.cameras.flatMap(frustum)];
    const low = [0, 1, 2].map((i) => Math.min(...points.map((p) => p[i] ?? 0))) as Vec3;
    const high = [0, 1, 2].map((i) => Math.max(...points.map((p) => p[i] ?? 0))) as Vec3;
    this.target = scale(add(low, high), 0.5);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const isInside = (spot: Spot | null) =>
      spot !== null && spot.x > 0.04 * width && spot.x < 0.96 * width && spot.y > 0.06 * height && spot.y < 0.96 * height;
    // From where the room fills the view best.
    let best = { azimuth: 0, distance: 60 };
    for (let k = 0; k < 36; k++) {
      this.azimuth = (k / 18) * Math.PI;
      this.distance = 1;
      while (this.distance < best.distance && !points.map(this.projection(width, height)).every(isInside)) this.distance *= 1.03;
      if (this.distance < best.distance) best = { azimuth: this.azimuth, distance: this.distance };
    }
    Object.assign(this, best);
  }

  follow(): void {
    this.follows = !this.follows;
    if (!this.follows) return;
    this.distance = Math.min(this.distance, 3);
  }

  orbit(right: number, up: number): void {
    this.azimuth += right;
    this.elevation = Math.min(1.55, Math.max(-0.3, this.elevation + up));
  }

  zoom(by: number): void {
    this.distance = Math.min(60, Math.max(0.4, this.distance * by));
  }

  private listen(): void {
    const { canvas } = this;
    const held = new Map<number, [number, number]>();
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = held.get(event.pointerId);
      if (!last) return;
      const apart = () => {
        const [a, b] = [...held.values()];
        return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
      };
      const before = apart();
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size === 1) this.orbit((last[0] - event.clientX) / 150, (event.clientY - last[1]) / 150);
      else if (before > 0 && apart() > 0) this.zoom(before / apart());
    });
    const release = (event: PointerEvent) => void held.delete(event.pointerId);
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY / 600));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.press(event.key)) return;
      event.preventDefault();
    });
  }

  /** Carries out a key; whether it is one of this view. */
  private press(key: string): boolean {
    const moves: Record<string, () => void> = {
      ArrowLeft: () => this.orbit(0.1, 0),
      ArrowRight: () => this.orbit(-0.1, 0),
      ArrowUp: () => this.orbit(0, 0.08),
      ArrowDown: () => this.orbit(0, -0.08),
      "+": () => this.zoom(1 / 1.15),
      "=": () => this.zoom(1 / 1.15),
      "-": () => this.zoom(1.15),
      "0": () => this.reset(),
    };
    moves[key]?.();
    return key in moves;
  }

  /** Axes of the eye: right, up, towards what it looks at. */
  private eye(): { at: Vec3; right: Vec3; up: Vec3; ahead: Vec3 } {
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    const ahead: Vec3 = [-ca * ce, -sa * ce, -se];
    return { at: add(this.target, scale(ahead, -this.distance)), right: [-sa, ca, 0], up: [-ca * se, -sa * se, ce], ahead };
  }

  /** From the world to the screen. */
  private projection(width: number, height: number): (point: Vec3) => Spot | null {
    const eye = this.eye();
    const focal = focalLength({ width, height });
    return (point) => {
      const d = sub(point, eye.at);
      const dot = (axis: Vec3) => d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2];
      const depth = dot(eye.ahead);
      if (depth < 0.05) return null;
      return { x: width / 2 + (focal * dot(eye.right)) / depth, y: height / 2 - (focal * dot(eye.up)) / depth, depth };
    };
  }

  draw(isLive: boolean): void {
    const surface = prepare(this.canvas);
    if (!surface) return;
    if (this.flight.scene !== this.scene) {
      this.scene = this.flight.scene;
      this.reset();
    }
    const { scene } = this;
    if (!scene) return;
    if (this.follows && this.flight.seen) this.target = this.flight.seen.position_m;
    const artist = new Artist(surface, this.projection(surface.width, surface.height), focalLength(surface));
    drawVolume(artist, scene);
    scene.cameras.forEach((camera, k) => drawCamera(artist, camera, this.flight.cameras[k]?.state?.state ?? "starting"));
    drawPath(artist, this.flight, scene.volume_m[0][2]);
    this.drawVehicle(artist, scene, isLive);
  }

  private drawVehicle(artist: Artist, scene: Scene, isLive: boolean): void {
    const { seen } = this.flight;
    if (!seen) {
      this.caption.textContent = "no pose yet";
      return;
    }
    const { ink, soft, gone, series, panel, font } = colours();
    const { pen } = artist;
    const place = (body: Vec3) => add(seen.position_m, turn(seen.attitude, body));
    const size = Math.max(0.08, ...scene.markers.map((marker) => norm(marker.in_body_m)));
    pen.save();
    if (!isLive) {
      pen.globalAlpha = 0.55;
      pen.setLineDash([3, 4]);
    }
    // The shadow on the floor shows where the aircraft is.
    const floor: Vec3 = [seen.position_m[0], seen.position_m[1], scene.volume_m[0][2]];
    artist.line([seen.position_m, floor], soft, 1);
    artist.circle(floor, [size * 0.7, 0, 0], [0, size * 0.7, 0], soft, 1);
    if (isLive) this.drawEllipsoid(artist, seen.position_m, seen.covariance, size);
    else this.caption.textContent = "last seen here";
    for (const marker of scene.markers) artist.line([seen.position_m, place(marker.in_body_m)], soft, 1.5);
    pen.font = `600 12px ${font}`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    const axes: [string, Vec3][] = [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]];
    axes.forEach(([name, axis], i) => {
      const colour = isLive ? (series[i] ?? ink) : gone;
      artist.line([seen.position_m, place(scale(axis, size * 1.7))], colour, 2.5);
      const end = artist.project(place(scale(axis, size * 2)));
      if (end) label(pen, name, end.x, end.y, colour, panel);
    });
    pen.setLineDash([]);
    drawMarkers(artist, scene, place, isLive);
    pen.restore();
  }

  /** Magnified so that it is about as large as the vehicle. */
  private drawEllipsoid(artist: Artist, centre: Vec3, covariance: readonly number[] | null, size_m: number): void {
    const root = covariance && positionRoot(covariance);
    if (!root) {
      this.caption.textContent = "";
      return;
    }
    // The longest half axis of two standard deviations is at most twice the root of the trace.
    const longest = 2 * Math.hypot(...root.map(norm));
    this.magnified = magnification(longest, size_m, this.magnified);
    const [a, b, c] = root.map((column) => scale(column, 2 * this.magnified)) as [Vec3, Vec3, Vec3];
    const { accent } = colours();
    artist.silhouette(centre, [a, b, c], accent);
    artist.circle(centre, a, b, accent, 1);
    artist.circle(centre, b, c, accent, 1);
    artist.circle(centre, c, a, accent, 1);
    this.caption.textContent = `ellipsoid: 2σ of position, ×${this.magnified}`;
  }
}

function focalLength({ width, height }: { width: number; height: number }): number {
  return Math.min(width, height * 1.35) / FIELD;
}

/** A camera's centre and the corners of its image, as they are drawn. */
function frustum(camera: CameraView): Vec3[] {
  return [camera.centre_m, ...camera.corners.map((direction) => add(camera.centre_m, scale(direction, FRUSTUM_M)))];
}

/** The calibrated volume: its floor with a grid of metres, its edges, and the world's axes. */
function drawVolume(artist: Artist, { volume_m: [low, high] }: Scene): void {
  const { line, soft, floor, panel, font } = colours();
  const corner = (x: number, y: number, z: number): Vec3 => [x ? high[0] : low[0], y ? high[1] : low[1], z ? high[2] : low[2]];
  artist.fill([corner(0, 0, 0), corner(1, 0, 0), corner(1, 1, 0), corner(0, 1, 0)], floor, 1);
  for (let x = Math.ceil(low[0]); x <= high[0]; x++) artist.line([[x, low[1], low[2]], [x, high[1], low[2]]], line, 1);
  for (let y = Math.ceil(low[1]); y <= high[1]; y++) artist.line([[low[0], y, low[2]], [high[0], y, low[2]]], line, 1);
  for (const z of [0, 1]) {
    artist.line([corner(0, 0, z), corner(1, 0, z), corner(1, 1, z), corner(0, 1, z), corner(0, 0, z)], line, 1);
  }
  for (const [x, y] of [[0, 0], [1, 0], [1, 1], [0, 1]]) artist.line([corner(x ?? 0, y ?? 0, 0), corner(x ?? 0, y ?? 0, 1)], line, 1);
  const { pen } = artist;
  pen.font = `11px ${font}`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const origin: Vec3 = [low[0], low[1], low[2]];
  const axes: [string, Vec3][] = [["X", [0.6, 0, 0]], ["Y", [0, 0.6, 0]], ["Z", [0, 0, 0.6]]];
  for (const [name, axis] of axes) {
    artist.line([origin, add(origin, axis)], soft, 1.5);
    const end = artist.project(add(origin, scale(axis, 1.25)));
    if (end) label(pen, name, end.x, end.y, soft, panel);
  }
}

function drawCamera(artist: Artist, camera: CameraView, state: string): void {
  const { ink, soft, bad, panel, font } = colours();
  const isWell = state === "running" || state === "starting";
  const colour = isWell ? soft : bad;
  const corners = frustum(camera).slice(1);
  const { pen } = artist;
  pen.save();
  if (!isWell) pen.setLineDash([4, 3]);
  artist.fill(corners, colour, 0.14);
  artist.line([...corners, corners[0] as Vec3], colour, 1.3);
  for (const corner of corners) artist.line([camera.centre_m, corner], colour, 1.3);
  pen.setLineDash([]);
  // The upper edge is thick.
  artist.line(corners.slice(0, 2), colour, 3);
  const spot = artist.project(camera.centre_m);
  if (spot) {
    pen.font = `12px ${font}`;
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    label(pen, isWell ? camera.name : `${camera.name}: ${state}`, spot.x, spot.y - 8, isWell ? ink : bad, panel);
  }
  pen.restore();
}

/** The path, fainter the longer ago, and its shadow. */
function drawPath(artist: Artist, { path }: Flight, floor_m: number): void {
  const { series, line } = colours();
  const { pen } = artist;
  const pieces = 24;
  for (let piece = 0; piece < pieces; piece++) {
    const from = Math.floor((piece * path.length) / pieces);
    const to = Math.floor(((piece + 1) * path.length) / pieces);
    let stretch: Vec3[] = [];
    const finish = (alpha: number) => {
      if (stretch.length > 1) {
        artist.line(stretch.map(([x, y]) => [x, y, floor_m]), line, 1);
        pen.globalAlpha = alpha;
        artist.line(stretch, series[0], 2);
        pen.globalAlpha = 1;
      }
      stretch = [];
    };
    for (const point of path.slice(from, to + 1)) {
      if (point) stretch.push(point);
      else finish(0.1 + (0.8 * piece) / pieces);
    }
    finish(0.1 + (0.8 * piece) / pieces);
  }
}

function drawMarkers(artist: Artist, scene: Scene, place: (body: Vec3) => Vec3, isLive: boolean): void {
  const { ink, gone, panel, font } = colours();
  const { pen } = artist;
  const spots = scene.markers
    .map((marker) => ({ marker, spot: artist.project(place(marker.in_body_m)) }))
    .sort((a, b) => (b.spot?.depth ?? 0) - (a.spot?.depth ?? 0));
  pen.font = `11px ${font}`;
  pen.textAlign = "left";
  for (const { marker, spot } of spots) {
    if (!spot) continue;
    const radius = Math.max(3, (artist.focal * marker.diameter_m) / 2 / spot.depth);
    pen.beginPath();
    pen.arc(spot.x, spot.y, radius, 0, 2 * Math.PI);
    if (isLive) {
      pen.fillStyle = `rgb(${marker.rgb.join(",")})`;
      pen.fill();
    }
    pen.strokeStyle = isLive ? ink : gone;
    pen.lineWidth = 1;
    pen.stroke();
    if (artist.focal / spot.depth > 120) label(pen, marker.name, spot.x + radius + 3, spot.y, isLive ? ink : gone, panel);
  }
}
