// The connection: opened again whenever it ends, and given up for dead when it is silent although the server beats twice a second.

import { type Command, type Message, parsePreview, type Preview } from "./events.ts";

const SILENCE_MS = 1500;
const GIVE_UP_MS = 4000;
const LONGEST_PAUSE_MS = 3000;

export interface Listener {
  message(message: Message): void;
  preview(preview: Preview): void;
  opened(): void;
}

export class Link {
  private socket: WebSocket | null = null;
  private heard_ms = performance.now();
  private pause_ms = 250;
  private readonly listener: Listener;

  constructor(listener: Listener) {
    this.listener = listener;
    this.open();
    setInterval(() => {
      if (this.socket?.readyState === WebSocket.OPEN && this.silent_ms() > GIVE_UP_MS) this.reopen();
    }, 500);
  }

  /** Whether the server was heard of late. */
  isAlive(): boolean {
    return this.socket?.readyState === WebSocket.OPEN && this.silent_ms() < SILENCE_MS;
  }

  /** Milliseconds since the server was last heard. */
  silent_ms(): number {
    return performance.now() - this.heard_ms;
  }

  send(command: Command): boolean {
    if (!this.socket || !this.isAlive()) return false;
    this.socket.send(JSON.stringify({ command }));
    return true;
  }

  private open(): void {
    const address = new URL("events", document.baseURI);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.heard_ms = performance.now();
      this.pause_ms = 250;
      this.listener.opened();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      this.heard_ms = performance.now();
      if (typeof event.data === "string") {
        this.listener.message(JSON.parse(event.data) as Message);
      } else {
        const preview = parsePreview(event.data);
        if (preview) this.listener.preview(preview);
      }
    };
    socket.onclose = () => {
      if (this.socket === socket) this.reopen();
    };
  }

  private reopen(): void {
    const old = this.socket;
    this.socket = null;
    old?.close();
    setTimeout(() => this.open(), this.pause_ms);
    this.pause_ms = Math.min(LONGEST_PAUSE_MS, this.pause_ms * 1.6);
  }
}
