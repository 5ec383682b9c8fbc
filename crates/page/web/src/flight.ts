// The state of the flight as far as it is known, and its age.

import type { Camera, Parameter, Parameters, Pose, Preview, Quaternion, Recording, Scene, Detections, Vec3 } from "./events.ts";
import { History } from "./history.ts";
import { norm, sub } from "./maths.ts";

/** One point of the path; none where the aircraft was not seen in between. */
export type PathPoint = Vec3 | null;

const PATH_POINTS = 1500;
/** Detections are kept for this time, because their picture comes later. */
const DETECTIONS_KEPT_S = 1;

export interface CameraNow {
  state: Camera | null;
  detections: Detections[];
  image: ImageBitmap | null;
  image_t_s: number;
  image_ms: number;
}

export class Flight {
  scene: Scene | null = null;
  /** The newest instant, measured or not. */
  pose: Pose | null = null;
  pose_ms = 0;
  /** The newest that was measured. */
  seen: (Pose & { position_m: Vec3; attitude: Quaternion }) | null = null;
  seen_ms = 0;
  readonly history = new History();
  readonly path: PathPoint[] = [];
  cameras: CameraNow[] = [];
  parameters: Parameters | null = null;
  /** The widest interval that each parameter has had. */
  readonly widest = new Map<string, { low: number; high: number }>();
  recording: Recording | null = null;
  /** Poses that the server left out of late, as the page did not take them fast enough. */
  skipped = 0;
  private skips: [number, number][] = [];
  /** Interval between instants, of late. */
  interval_ms = 33;
  rate_hz = 0;
  /** When each pose of the last two seconds came, how much later than it was captured (but for a constant), and its instant. */
  private arrivals: { now_ms: number; delay_ms: number; t_s: number }[] = [];

  start(scene: Scene): void {
    // The same flight heard again after the connection was lost: its history is kept.
    if (this.scene && JSON.stringify(scene) === JSON.stringify(this.scene)) return;
    this.scene = scene;
    this.pose = null;
    this.seen = null;
    this.history.clear();
    this.path.length = 0;
    for (const camera of this.cameras) camera.image?.close();
    this.cameras = scene.cameras.map(() => ({ state: null, detections: [], image: null, image_t_s: 0, image_ms: 0 }));
    this.arrivals = [];
  }

  takePose(pose: Pose): void {
    const now = performance.now();
    if (this.pose && pose.t_s < this.pose.t_s) {
      this.path.length = 0;
      this.widest.clear();
      this.arrivals = [];
    } else if (this.pose) {
      const step_s = (pose.t_s - this.pose.t_s) / Math.max(1, pose.sequence - this.pose.sequence);
      if (step_s > 0 && step_s < 1) this.interval_ms += 0.05 * (1000 * step_s - this.interval_ms);
    }
    this.pose = pose;
    this.pose_ms = now;
    this.history.push(pose);
    this.arrivals.push({ now_ms: now, delay_ms: now - pose.captured_ns / 1e6, t_s: pose.t_s });
    while (now - (this.arrivals[0]?.now_ms ?? now) > 2000) this.arrivals.shift();
    const since_s = pose.t_s - (this.arrivals[0]?.t_s ?? pose.t_s);
    this.rate_hz = since_s > 0.1 ? (this.arrivals.length - 1) / since_s : 0;
    if (pose.valid && pose.position_m && pose.attitude) {
      this.seen = { ...pose, position_m: pose.position_m, attitude: pose.attitude };
      this.seen_ms = now;
      const last = this.path.at(-1);
      if (!last || norm(sub(last, pose.position_m)) > 0.005) this.path.push(pose.position_m);
    } else if (this.path.at(-1)) {
      this.path.push(null);
    }
    if (this.path.length > PATH_POINTS) this.path.splice(0, this.path.length - PATH_POINTS);
  }

  takeDetections(detections: Detections): void {
    const camera = this.cameras[detections.camera];
    if (!camera) return;
    if ((camera.detections.at(-1)?.t_s ?? Number.NEGATIVE_INFINITY) >= detections.t_s) camera.detections.length = 0;
    camera.detections.push(detections);
    while ((camera.detections[0]?.t_s ?? detections.t_s) < detections.t_s - DETECTIONS_KEPT_S) camera.detections.shift();
  }

  async takePreview(preview: Preview): Promise<void> {
    const image = await createImageBitmap(preview.jpeg).catch(() => null);
    const camera = this.cameras[preview.camera];
    if (!image || !camera) return;
    camera.image?.close();
    Object.assign(camera, { image, image_t_s: preview.t_s, image_ms: performance.now() });
  }

  takeParameters(parameters: Parameters): void {
    this.parameters = parameters;
    for (const one of parameters.parameters) this.widen(one);
  }

  private widen({ name, value, half_width }: Parameter): void {
    if (value === null || half_width === null) return;
    const widest = this.widest.get(name);
    if (!widest || 2 * half_width > widest.high - widest.low) {
      this.widest.set(name, { low: value - half_width, high: value + half_width });
    } else if (value - half_width < widest.low || value + half_width > widest.high) {
      const reach = Math.max(widest.high - widest.low, 2 * half_width);
      const centre = Math.min(Math.max((widest.low + widest.high) / 2, value + half_width - reach / 2), value - half_width + reach / 2);
      this.widest.set(name, { low: centre - reach / 2, high: centre + reach / 2 });
    }
  }

  takeSkipped(sinceOpened: number): void {
    const now = performance.now();
    if ((this.skips.at(-1)?.[1] ?? 0) > sinceOpened) this.skips.length = 0;
    this.skips.push([now, sinceOpened]);
    while (this.skips.length > 1 && now - (this.skips[0]?.[0] ?? now) > 5000) this.skips.shift();
    this.skipped = sinceOpened - (this.skips[0]?.[1] ?? 0);
  }

  /** Milliseconds since the newest instant came. */
  poseAge_ms(): number {
    return this.pose ? performance.now() - this.pose_ms : Number.POSITIVE_INFINITY;
  }

  /** Milliseconds since the newest measured pose came. */
  seenAge_ms(): number {
    return this.seen ? performance.now() - this.seen_ms : Number.POSITIVE_INFINITY;
  }

  /** A pose older than this is no longer shown as if it were now: three instants, or what a browser's own pauses take. */
  patience_ms(): number {
    return Math.max(300, 3 * this.interval_ms);
  }

  /** How much later poses come than the quickest of late: what has piled up on the way. */
  behind_ms(): number {
    const newest = this.arrivals.at(-1);
    return newest ? newest.delay_ms - Math.min(...this.arrivals.map(({ delay_ms }) => delay_ms)) : 0;
  }

  /** Flight time now, as the newest instant has it. */
  now_s(): number {
    return this.pose ? this.pose.t_s + this.poseAge_ms() / 1000 : 0;
  }

  /** What a camera saw in the picture that is shown; in none, what it saw last. */
  detectionsShown(camera: CameraNow): Detections | undefined {
    if (!camera.image) return camera.detections.at(-1);
    let best: Detections | undefined;
    for (const detections of camera.detections) {
      const nearer = Math.abs(detections.t_s - camera.image_t_s) < Math.abs((best?.t_s ?? Number.POSITIVE_INFINITY) - camera.image_t_s);
      if (nearer) best = detections;
    }
    return best && Math.abs(best.t_s - camera.image_t_s) < this.interval_ms / 500 ? best : undefined;
  }
}
