// The head of the page, the parameters, and the notes.

import type { Note, Parameter } from "./events.ts";
import type { Flight } from "./flight.ts";
import type { Link } from "./link.ts";
import { withUncertainty } from "./maths.ts";
import { byId, element, say } from "./page.ts";

/** What the head says in large letters. */
interface Standing {
  state: "good" | "busy" | "bad" | "off";
  sign: string;
  word: string;
  why: string;
}

const seconds = (ms: number) => (ms < 9950 ? `${(ms / 1000).toFixed(1)} s` : `${Math.round(ms / 1000)} s`);

/** The state of the flight for the user: old values are never shown as present ones. */
export function standing(flight: Flight, link: Link): Standing {
  if (!link.isAlive()) {
    const since = seconds(link.silent_ms());
    if (!flight.scene) return { state: "off", sign: "…", word: "Connecting", why: since };
    return { state: "bad", sign: "⚠", word: "Connection lost", why: `nothing heard for ${since}; trying again` };
  }
  const { pose } = flight;
  if (!flight.scene || !pose) return { state: "off", sign: "…", word: "Waiting", why: "no frame yet" };
  if (flight.poseAge_ms() > Math.max(500, flight.patience_ms())) {
    return { state: "bad", sign: "⚠", word: "No frames", why: `the last came ${seconds(flight.poseAge_ms())} ago` };
  }
  const ago = flight.seen ? `last pose ${seconds(flight.seenAge_ms())} ago` : "";
  const reason = [pose.reason, pose.valid ? "" : ago].filter(Boolean).join(" · ");
  switch (pose.tracking) {
    case "tracking":
      return { state: "good", sign: "●", word: "Tracking", why: reason };
    case "reacquired":
      return { state: "good", sign: "↺", word: "Reacquired", why: reason };
    case "acquiring":
      return { state: "busy", sign: "◌", word: "Acquiring", why: reason || "looking for the aircraft" };
    case "lost":
      return { state: "bad", sign: "✕", word: "Lost", why: reason };
  }
}

export class Head {
  private readonly flight: Flight;
  private readonly link: Link;

  constructor(flight: Flight, link: Link) {
    this.flight = flight;
    this.link = link;
  }

  write(isLive: boolean): void {
    const { flight } = this;
    const { state, sign, word, why } = standing(flight, this.link);
    const box = byId("tracking");
    box.dataset["state"] = state;
    say(byId("tracking-sign"), sign);
    say(byId("tracking-word"), word);
    say(byId("tracking-why"), why);
    say(byId("name"), flight.scene?.name ?? "mavsight");
    document.title = `${sign} ${word} – ${flight.scene?.name ?? "mavsight"}`;
    document.body.dataset["live"] = String(isLive);
    const { pose } = flight;
    say(byId("time"), pose ? pose.t_s.toFixed(2) : "–");
    say(byId("rate"), this.link.isAlive() && pose && flight.poseAge_ms() < 2000 ? flight.rate_hz.toFixed(1) : "–");
    say(byId("latency"), isLive && pose ? pose.latency_ms.toFixed(2) : "–");
    say(byId("residual"), isLive && pose && pose.residual_px !== null ? pose.residual_px.toFixed(3) : "–");
    const behind = flight.behind_ms();
    const late = behind > 500 ? `This page is ${seconds(behind)} behind the flight. ` : "";
    say(byId("behind"), late + (flight.skipped > 0 ? `This page is too slow: ${flight.skipped} poses of the last 5 s left out.` : ""));
  }
}

export class ParameterList {
  private readonly flight: Flight;
  private readonly list: HTMLElement;
  private readonly summary: HTMLElement;
  private readonly rows = new Map<string, { row: HTMLElement; value: HTMLElement; bar: HTMLElement; mark: HTMLElement }>();

  constructor(flight: Flight, list: HTMLElement, summary: HTMLElement) {
    this.flight = flight;
    this.list = list;
    this.summary = summary;
  }

  write(): void {
    const parameters = this.flight.parameters;
    if (!parameters) {
      this.list.replaceChildren();
      this.rows.clear();
      say(this.summary, this.flight.scene ? "none yet" : "");
      delete this.summary.dataset["enough"];
      return;
    }
    const done = parameters.parameters.filter((one) => one.enough).length;
    const all = parameters.parameters.length;
    say(this.summary, parameters.enough ? "✓ Seen enough" : `${done} of ${all} seen enough`);
    this.summary.dataset["enough"] = String(parameters.enough);
    const names = new Set(parameters.parameters.map((one) => one.name));
    for (const [name, { row }] of this.rows) {
      if (names.has(name)) continue;
      row.remove();
      this.rows.delete(name);
    }
    for (const one of parameters.parameters) this.writeOne(one);
  }

  private writeOne(one: Parameter): void {
    let parts = this.rows.get(one.name);
    if (!parts) {
      const [value, bar, mark] = [element("output"), element("span"), element("b")];
      bar.className = "interval";
      const track = element("div", [bar]);
      track.className = "track";
      const name = element("span", one.name);
      name.title = one.name;
      const row = element("li", [name, value, track, mark]);
      parts = { row, value, bar, mark };
      this.rows.set(one.name, parts);
      this.list.append(row);
    }
    const { value, half_width: half } = one;
    const isKnown = value !== null && half !== null;
    say(parts.value, isKnown ? withUncertainty(value, half) : "not determined");
    say(parts.mark, one.enough ? "✓" : "");
    parts.mark.title = one.enough ? "seen as exactly as was asked for" : "";
    parts.row.dataset["enough"] = String(one.enough);
    const widest = this.flight.widest.get(one.name);
    parts.bar.hidden = !isKnown || !widest;
    if (isKnown && widest) {
      const span = widest.high - widest.low || 1;
      parts.bar.style.left = `${(100 * (value - half - widest.low)) / span}%`;
      parts.bar.style.width = `${(100 * 2 * half) / span}%`;
    }
  }
}

const NOTES_KEPT = 100;

export class Notes {
  private readonly list: HTMLElement;
  private readonly alarm: HTMLElement;

  constructor(list: HTMLElement, alarm: HTMLElement) {
    this.list = list;
    this.alarm = alarm;
  }

  add({ t_s, fault, text }: Pick<Note, "t_s" | "fault" | "text">): void {
    const time = element("time", t_s === null ? "" : `${t_s.toFixed(1)} s`);
    const kind = element("b", fault ? "▲ Fault" : "i");
    const item = element("li", [time, kind, element("span", text)]);
    item.className = fault ? "fault" : "";
    this.list.prepend(item);
    while (this.list.childElementCount > NOTES_KEPT) this.list.lastElementChild?.remove();
    if (fault) this.alarm.textContent = text;
  }

  clear(): void {
    this.list.replaceChildren();
  }
}
