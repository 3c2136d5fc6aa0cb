// Answers in parts: a list too long for one small message travels as several, and arrives as one.
//
// Small messages matter: mosquitto 2.0, the broker of most labs, sends a browser about 4 KB per 100 ms of any longer one.

import { BadPayload } from "./errors";
import type { Json, JsonObject } from "./json";

// Together they bound what a hostile server can make us keep: 64 MiB.
const MOST_PARTS = 1024;
const MOST_OPEN = 4;
/** Of a sealed part. */
export const PART_MAX_BYTES = 16 * 1024;

interface Open {
  readonly parts: number;
  readonly got: Map<number, readonly Json[]>;
}

/** Puts answers together again, a few at a time; the oldest unfinished one is forgotten first. */
export class PartsInbox {
  readonly #open = new Map<string, Open>();

  /** The whole list once its last part is here, else undefined. @throws BadPayload */
  take(request: number, words: JsonObject): Json[] | undefined {
    const { answer, part, parts, data } = words;
    if (!isCount(answer) || !isCount(part) || !isCount(parts) || !Array.isArray(data)) {
      throw new BadPayload("a part of an answer has whole numbers answer, part and parts, and a list");
    }
    if (parts < 1 || parts > MOST_PARTS || part >= parts) throw new BadPayload("a part that cannot be");
    const key = `${request} ${answer}`;
    const open: Open = this.#open.get(key) ?? { parts, got: new Map() };
    if (open.parts !== parts) throw new BadPayload("an answer that changes its number of parts");
    this.#open.set(key, open);
    open.got.set(part, data as readonly Json[]);
    if (open.got.size === parts) {
      this.#open.delete(key);
      return Array.from({ length: parts }, (_, i) => open.got.get(i) ?? []).flat();
    }
    for (const oldest of this.#open.keys()) {
      if (this.#open.size <= MOST_OPEN) break;
      this.#open.delete(oldest);
    }
    return undefined;
  }
}

function isCount(word: unknown): word is number {
  return Number.isSafeInteger(word) && (word as number) >= 0;
}
