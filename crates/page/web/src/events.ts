// What the server sends: `mavsight_link::Event` as JSON, distinguished by `event`, and its own beat. Metres in world axes (Z up),
// quaternions (w, x, y, z) `world_from_body`, angles in radians, seconds since the flight began.
// `examples.ts`, written by the server's tests, holds these types to what is really sent.

export type Vec3 = [number, number, number];
export type Quaternion = [number, number, number, number];
export type TrackingState = "acquiring" | "tracking" | "lost" | "reacquired";
export type CameraState = "starting" | "running" | "stalled" | "gone" | "moved" | "frozen" | "dark";

export interface CameraView {
  name: string;
  width_px: number;
  height_px: number;
  centre_m: Vec3;
  corners: [Vec3, Vec3, Vec3, Vec3];
}

export interface MarkerView {
  name: string;
  rgb: Vec3;
  in_body_m: Vec3;
  diameter_m: number;
}

export interface Scene {
  event: "scene";
  name: string;
  cameras: CameraView[];
  markers: MarkerView[];
  volume_m: [Vec3, Vec3];
}

export interface Pose {
  event: "pose";
  t_s: number;
  sequence: number;
  captured_ns: number;
  valid: boolean;
  tracking: TrackingState;
  position_m: Vec3 | null;
  attitude: Quaternion | null;
  euler_rad: Vec3 | null;
  /** Upper triangle by rows of 6×6: position in world axes, then a small turn about body axes. */
  covariance: number[] | null;
  velocity_in_body_m_s: Vec3 | null;
  velocity_std_m_s: Vec3 | null;
  rates_rad_s: Vec3 | null;
  rates_std_rad_s: Vec3 | null;
  residual_px: number | null;
  latency_ms: number;
  reason: string | null;
}

export interface DetectedBall {
  u_px: number;
  v_px: number;
  diameter_px: number;
  marker: number | null;
  residual_px: [number, number] | null;
}

export interface Detections {
  event: "detections";
  camera: number;
  t_s: number;
  seen: DetectedBall[];
}

export interface Camera {
  event: "camera";
  camera: number;
  state: CameraState;
  rate_hz: number;
  latency_ms: number;
  missing: number;
  dropped: number;
  markers: number[];
  reason: string | null;
}

export interface Parameter {
  name: string;
  value: number | null;
  half_width: number | null;
  enough: boolean;
}

export interface Parameters {
  event: "parameters";
  t_s: number;
  parameters: Parameter[];
  enough: boolean;
}

export interface Recording {
  event: "recording";
  folder: string | null;
  seconds: number;
  bytes: number;
  fault: string | null;
}

export interface Note {
  event: "note";
  t_s: number | null;
  fault: boolean;
  text: string;
}

/** What a flight sends. */
export type FlightEvent = Scene | Pose | Detections | Camera | Parameters | Recording | Note;

/** The server is there; `dropped` poses came too fast for this page. */
export interface Beat {
  event: "beat";
  dropped: number;
}

export type Message = FlightEvent | Beat;

export type Command = "start_recording" | "stop_recording" | "calibrate" | "self_check";

/** A picture of a camera at an instant, nanoseconds since the flight began. */
export interface Preview {
  camera: number;
  t_s: number;
  jpeg: Blob;
}

/** A binary message: one byte of camera, eight of the instant (little endian), a JPEG. */
export function parsePreview(bytes: ArrayBuffer): Preview | null {
  if (bytes.byteLength <= 9) return null;
  const view = new DataView(bytes);
  return {
    camera: view.getUint8(0),
    t_s: Number(view.getBigInt64(1, true)) / 1e9,
    jpeg: new Blob([new Uint8Array(bytes, 9)], { type: "image/jpeg" }),
  };
}
