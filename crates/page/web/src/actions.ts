// What a user can ask for, by button or key.

import type { Command } from "./events.ts";
import type { Flight } from "./flight.ts";
import type { Link } from "./link.ts";
import type { Notes } from "./panels.ts";
import { byId, say } from "./page.ts";

const THEMES = ["light", "dark"] as const;

export class Actions {
  private readonly flight: Flight;
  private readonly link: Link;
  private readonly notes: Notes;

  constructor(flight: Flight, link: Link, notes: Notes, themed: () => void, follow: () => void) {
    this.flight = flight;
    this.link = link;
    this.notes = notes;
    const keys: Record<string, () => void> = {
      r: () => this.record(),
      c: () => this.calibrate(),
      s: () => this.ask("self_check", "Self-check asked for"),
      f: follow,
      t: () => {
        changeTheme();
        themed();
      },
      "?": () => openDialog("help"),
    };
    for (const button of document.querySelectorAll<HTMLButtonElement>("button[data-key]")) {
      button.addEventListener("click", () => keys[button.dataset["key"] ?? ""]?.());
    }
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || document.querySelector("dialog[open]")) return;
      const act = keys[event.key.toLowerCase()];
      if (!act) return;
      event.preventDefault();
      act();
    });
    const sure = byId<HTMLDialogElement>("sure");
    sure.addEventListener("close", () => {
      if (sure.returnValue === "yes") this.ask("calibrate", "Calibration asked for");
    });
    // Without a stored theme the system's applies; scripts see that too.
    restoreTheme();
    themed();
  }

  private ask(command: Command, said: string): void {
    if (this.link.send(command)) {
      this.notes.add({ t_s: this.flight.pose?.t_s ?? null, fault: false, text: `${said}.` });
    } else {
      this.notes.add({ t_s: null, fault: true, text: `${said}, but there is no connection: nothing was done.` });
    }
  }

  private record(): void {
    if (this.flight.recording?.folder) this.ask("stop_recording", "End of the recording asked for");
    else this.ask("start_recording", "Recording asked for");
  }

  private calibrate(): void {
    const sure = byId<HTMLDialogElement>("sure");
    sure.returnValue = "";
    openDialog("sure");
  }

  write(): void {
    const { recording } = this.flight;
    const isRecording = Boolean(recording?.folder);
    const button = byId<HTMLButtonElement>("record");
    button.setAttribute("aria-pressed", String(isRecording));
    button.dataset["fault"] = String(Boolean(recording?.fault));
    say(byId("record-word"), isRecording ? "■ Stop" : "● Record");
    const size = ((recording?.bytes ?? 0) / 1e6).toFixed(1);
    const length = Math.floor(recording?.seconds ?? 0);
    const clock = `${Math.floor(length / 60)}:${String(length % 60).padStart(2, "0")}`;
    say(byId("record-size"), recording?.fault ? "▲ fault" : isRecording ? `${clock} · ${size} MB` : "");
    for (const id of ["record", "calibrate", "self-check"]) byId(id).setAttribute("aria-disabled", String(!this.link.isAlive()));
  }
}

function openDialog(id: string): void {
  byId<HTMLDialogElement>(id).showModal();
}

/** The theme in use, whether chosen here or the system's. */
function theme(): (typeof THEMES)[number] {
  const chosen = document.documentElement.dataset["theme"];
  if (chosen === "light" || chosen === "dark") return chosen;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

function changeTheme(): void {
  const next = theme() === "dark" ? "light" : "dark";
  document.documentElement.dataset["theme"] = next;
  try {
    localStorage.setItem("theme", next);
  } catch {
    // A browser that keeps nothing starts with the system's theme.
  }
}

function restoreTheme(): void {
  try {
    const kept = localStorage.getItem("theme");
    if (kept === "light" || kept === "dark") document.documentElement.dataset["theme"] = kept;
  } catch {
    // As above.
  }
}
