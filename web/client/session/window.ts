// The sliding window of counters: each record of a direction and generation is opened once. Source: RFC 4303 §3.4.3.

import { Replayed } from "../core/errors";

/** A record that is further behind the newest is refused. */
export const WIDTH = 1024;
/** Nobody counts so far. */
export const COUNTER_LIMIT = 2 ** 48;

/** The counters that were received. */
export class Window {
  #newest = -1;
  /** Counters of the last WIDTH, each at its remainder; -1: none. */
  readonly #seen = new Float64Array(WIDTH).fill(-1);

  /** Larger than all that were received. */
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

  /** Remember a counter that was checked, once its record is authentic. */
  enter(counter: number): void {
    this.#seen[counter % WIDTH] = counter;
    this.#newest = Math.max(this.#newest, counter);
  }
}
