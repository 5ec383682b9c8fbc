// The page of a running flight.

import "./page.css";
import { Actions } from "./actions.ts";
import { Cameras } from "./cameras.ts";
import { forgetColours } from "./canvas.ts";
import type { Camera, Message, Recording } from "./events.ts";
import { Flight } from "./flight.ts";
import { Link } from "./link.ts";
import { byId } from "./page.ts";
import { Head, Notes, ParameterList } from "./panels.ts";
import { Room } from "./room.ts";
import { Strips } from "./strips.ts";

const flight = new Flight();
const notes = new Notes(byId("notes"), byId("alarm"));
const cameras = new Cameras(flight, byId("pictures"), byId("residual-scale"), byId<HTMLTableElement>("health"));
const room = new Room(flight, byId<HTMLCanvasElement>("room"), byId("room-caption"));
const strips = new Strips(flight, byId("strips"));
const parameters = new ParameterList(flight, byId("parameters"), byId("enough"));

const link = new Link({
  message: take,
  preview: (preview) => void flight.takePreview(preview),
  // The server sends all states again, notes too.
  opened: () => notes.clear(),
});
const head = new Head(flight, link);
const actions = new Actions(flight, link, notes, forgetColours, () => room.follow());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", forgetColours);

function take(message: Message): void {
  switch (message.event) {
    case "scene":
      return flight.start(message);
    case "pose":
      return flight.takePose(message);
    case "detections":
      return flight.takeDetections(message);
    case "camera":
      return takeCamera(message);
    case "parameters":
      return flight.takeParameters(message);
    case "recording":
      return takeRecording(message);
    case "note":
      return notes.add(message);
    case "beat":
      return flight.takeSkipped(message.dropped);
  }
}

function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function takeCamera(message: Camera): void {
  const camera = flight.cameras[message.camera];
  if (!camera) return;
  const name = flight.scene?.cameras[message.camera]?.name ?? `camera ${message.camera}`;
  const before = camera.state?.state;
  const wasIll = before !== undefined && before !== "running" && before !== "starting";
  const isIll = message.state !== "running" && message.state !== "starting";
  const t_s = flight.pose?.t_s ?? null;
  if (isIll && before !== message.state) {
    notes.add({ t_s, fault: true, text: `${name} is ${message.state}. ${sentence(message.reason ?? "")}` });
  } else if (wasIll && message.state === "running") {
    notes.add({ t_s, fault: false, text: `${name} is running again.` });
  }
  camera.state = message;
}

function takeRecording(message: Recording): void {
  const before = flight.recording;
  const t_s = flight.pose?.t_s ?? null;
  if (message.fault && message.fault !== before?.fault) notes.add({ t_s, fault: true, text: message.fault });
  if (message.folder && message.folder !== before?.folder) notes.add({ t_s, fault: false, text: `Recording into ${message.folder}.` });
  if (before?.folder && !message.folder) notes.add({ t_s, fault: false, text: `Recorded ${before.folder}.` });
  flight.recording = message;
}

/** Whether what was seen last may be shown as what is. */
function isLive(): boolean {
  return link.isAlive() && flight.seenAge_ms() < flight.patience_ms();
}

/** Thirty pictures a second, fewer where the browser is slow: two thirds of the time are left to take what comes. */
const LEAST_INTERVAL_MS = 30;
let drawn_ms = 0;
let cost_ms = 0;
let hasDrawn = false;
let drawsStrips = false;

function draw(now_ms: number): void {
  requestAnimationFrame(draw);
  const since_ms = now_ms - drawn_ms;
  // The frame after a drawn one comes late by what drawing it cost.
  if (hasDrawn) cost_ms += 0.2 * (Math.min(since_ms, 200) - cost_ms);
  hasDrawn = false;
  if (since_ms < Math.max(LEAST_INTERVAL_MS, 3 * (cost_ms - 17))) return;
  drawn_ms = now_ms;
  hasDrawn = true;
  room.draw(isLive());
  drawsStrips = !drawsStrips;
  if (drawsStrips) strips.draw();
  else cameras.draw(link.isAlive());
}

const WRITE_INTERVAL_MS = 100;
let written_ms = 0;
let yields = false;

/** Texts change so often that they can be read. */
function write(): void {
  // After a pause of the page itself what has come meanwhile is taken first: it is not old.
  const now_ms = performance.now();
  const paused = !yields && now_ms - written_ms > 1.5 * WRITE_INTERVAL_MS;
  written_ms = now_ms;
  yields = paused;
  if (paused) return void setTimeout(write, 0);
  head.write(isLive());
  strips.write(isLive());
  cameras.write(link.isAlive());
  parameters.write();
  actions.write();
  byId("follow").setAttribute("aria-pressed", String(room.follows));
}

requestAnimationFrame(draw);
setInterval(write, WRITE_INTERVAL_MS);
