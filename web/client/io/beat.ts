// A constant rate: from the first command, one slot every 100 ms, until no robot is held and nothing was sent for a while.

import { SLOT_MS, Slots } from "../session";

/** A client without commands leaves the constant rate after this time. */
const LINGER_MS = 1000;

/** What the rate needs of a session. */
export interface Speaker {
  /** Whether records can be sent now. */
  isJoined(): boolean;
  /** Whether a robot is held: then every slot is used. */
  holds(): boolean;
  /** Send an empty record, as long as a command. */
  alive(now_ms: number): void;
}

/** One client's slots, and their timer. */
export class Beat {
  readonly slots = new Slots();
  readonly #speaker: Speaker;
  #beating: ReturnType<typeof setInterval> | undefined;
  #saidAt_ms = 0;

  constructor(speaker: Speaker) {
    this.#speaker = speaker;
  }

  /** Whether slots are running: then all records wait for one. */
  get isBeating(): boolean {
    return this.#beating !== undefined;
  }

  /** Use the first slot now, unless slots are running. */
  start(): void {
    if (this.#beating === undefined) this.take();
  }

  /** Use a slot now: the next one may never come. */
  take(): void {
    if (!this.#speaker.isJoined()) {
      this.#pause();
      return;
    }
    const now_ms = performance.now();
    const saying = this.slots.take(now_ms);
    if (saying) this.#saidAt_ms = now_ms;
    else if (!this.#speaker.holds() && now_ms - this.#saidAt_ms > LINGER_MS) {
      this.#pause();
      return;
    }
    this.#beating ??= setInterval(() => this.take(), SLOT_MS);
    if (saying) saying.say(now_ms);
    else this.#speaker.alive(now_ms);
  }

  /** Drop waiting records: the session is over or lost. */
  stop(): void {
    this.#pause();
    this.slots.clear();
  }

  #pause(): void {
    clearInterval(this.#beating);
    this.#beating = undefined;
  }
}
