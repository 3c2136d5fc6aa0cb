// A constant rate: from the first command on a slot is taken every 100 ms, until nothing is held and nothing was said.

import { SLOT_MS, Slots } from "../session";

/** Whoever says nothing more frees its place in the rate. */
const LINGER_MS = 1000;

/** What the rate needs of a session. */
export interface Speaker {
  /** Whether anything can be said now. */
  isJoined(): boolean;
  /** Whether a robot is held: then something is said in every slot. */
  holds(): boolean;
  /** Say that nothing is to be said: that is as long as a command. */
  alive(now_ms: number): void;
}

/** One client's slots, and the clock that takes them. */
export class Beat {
  readonly slots = new Slots();
  readonly #speaker: Speaker;
  #beating: ReturnType<typeof setInterval> | undefined;
  #saidAt_ms = 0;

  constructor(speaker: Speaker) {
    this.#speaker = speaker;
  }

  /** Whether slots are taken: then all that is said waits for one. */
  get isBeating(): boolean {
    return this.#beating !== undefined;
  }

  /** Take the first slot now, unless slots are taken already. */
  start(): void {
    if (this.#beating === undefined) this.take();
  }

  /** Take a slot now: the next one may never come. */
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

  /** Forget what waits: the session is over, or was lost. */
  stop(): void {
    this.#pause();
    this.slots.clear();
  }

  #pause(): void {
    clearInterval(this.#beating);
    this.#beating = undefined;
  }
}
