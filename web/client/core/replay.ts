// The replay cache: every authentic message counts once. The same rules, in the same order, as the gateway's.

import { CacheFull, Replayed, Stale } from "./errors";

/** Of a small cache too: a list of many robots comes in one second. */
const LEAST_AT_ONCE = 64;

/**
 * Remembers (epoch, IV) until the message would be stale anyway.
 *
 * When full it refuses: forgetting inside the window would let a flood reopen the door to a replay. It fills no faster
 * than it empties, but for an eighth at once: so it is full for no longer than somebody floods, however the flood is dated.
 */
export class ReplayCache {
  readonly #capacity: number;
  readonly #atOnce: number;
  readonly #aSecond: number;
  readonly #tolerance_s: number;
  readonly #seen = new Set<string>();
  // Entries by the whole second in which they expire: a sweep drops whole seconds and never sorts.
  readonly #bySecond = new Map<number, string[]>();
  #sweptTo = Number.NEGATIVE_INFINITY;
  #room: number;
  #filledAt_s = Number.NEGATIVE_INFINITY;

  constructor(capacity: number, tolerance_s: number) {
    this.#capacity = capacity;
    this.#atOnce = Math.max(LEAST_AT_ONCE, capacity / 8);
    // Dated ahead, a message stays for twice the tolerance, and up to two seconds more until its second is swept.
    this.#aSecond = (capacity * 7) / 8 / (2 * tolerance_s + 2);
    this.#room = this.#atOnce;
    this.#tolerance_s = tolerance_s;
  }

  get size(): number {
    return this.#seen.size;
  }

  /**
   * Take note of an authentic message, or refuse it. A refused message leaves the cache unchanged.
   *
   * @param iv as text, in any one spelling.
   * @throws Stale, Replayed, CacheFull
   */
  enter(epoch: string, iv: string, timestamp_s: number, now_s: number): void {
    const skew_s = timestamp_s - now_s;
    if (!(Math.abs(skew_s) <= this.#tolerance_s)) throw new Stale(skew_s);
    this.#sweep(now_s);
    const second = Math.floor(timestamp_s + this.#tolerance_s) + 1;
    // The clock was set back: this message may be one we have already forgotten.
    if (second <= this.#sweptTo) throw new Stale(skew_s);
    const entry = `${epoch} ${iv}`;
    if (this.#seen.has(entry)) throw new Replayed("this IV was seen before");
    if (this.#seen.size >= this.#capacity) throw new CacheFull(`${this.#capacity} messages at once`);
    if (now_s > this.#filledAt_s) {
      this.#room = Math.min(this.#atOnce, this.#room + (now_s - this.#filledAt_s) * this.#aSecond);
    }
    this.#filledAt_s = now_s;
    if (this.#room < 1) throw new CacheFull(`${this.#aSecond} messages a second`);
    this.#room -= 1;
    this.#seen.add(entry);
    const due = this.#bySecond.get(second);
    if (due) due.push(entry);
    else this.#bySecond.set(second, [entry]);
  }

  #sweep(now_s: number): void {
    if (now_s <= this.#sweptTo + 1) return;
    // An entry of second s was stale from s on: its timestamp + tolerance lies below s.
    for (const [second, entries] of this.#bySecond) {
      if (second > now_s) continue;
      for (const entry of entries) this.#seen.delete(entry);
      this.#bySecond.delete(second);
    }
    this.#sweptTo = Math.floor(now_s);
  }
}
