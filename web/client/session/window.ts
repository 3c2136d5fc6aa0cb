// Sliding window of counters: each record of a direction and generation is opened once. Source: RFC 4303 §3.4.3.

import { Replayed } from "../core/errors";

/** Records further behind the newest are refused. */
export const WIDTH = 1024;
/** More than any session can count. */
export const COUNTER_LIMIT = 2 ** 48;

/** The counters received so far. */
export class Window {
  #newest = -1;
  /** Counters of the last WIDTH, each at its remainder; -1: none. */
  readonly #seen = new Float64Array(WIDTH).fill(-1);

  /** Larger than all received counters. */
  isNewest(counter: number): boolean {
    return counter > this.#newest;
  }

  /** @throws Replayed: it was received, or may have been. */
  check(counter: number): void {
    const tooOld = this.#newest - counter >= WIDTH;
    if (counter >= COUNTER_LIMIT || tooOld || this.#seen[counter % WIDTH] === counter) {
      throw new Replayed(`counter ${counter}, newest ${this.#newest}`);
    }
  }

  /** Record a checked counter, once its record is authentic. */
  enter(counter: number): void {
    this.#seen[counter % WIDTH] = counter;
    this.#newest = Math.max(this.#newest, counter);
  }
}
