// A swarm's task: its recent score, and the places of its objects.

import type { Json, JsonObject } from "./core/json";
import { list } from "./frame";
import { readNumber, readPointXy, readText } from "./reading";
import type { Point } from "./trail";

const LONGEST = 40;
const MOST_SCORE = 1e6;
const MOST_S = 86_400;
const MOST_THINGS = 32;

export interface Work {
  readonly name: string;
  /** Undefined while there was nothing to count. */
  readonly score: number | undefined;
  /** The unit of the score, and what it counts. */
  readonly counts: string;
  readonly lately_s: number;
  readonly things: readonly Point[];
}

/** `work` and `things` of an update, merged into the known state. */
export function workInFrame(known: Work | undefined, frame: JsonObject): Work | undefined {
  const work = readWork(list(frame["work"]).at(-1), known?.things ?? []) ?? known;
  const things = list(frame["things"]).at(-1);
  return work && Array.isArray(things) ? { ...work, things: readThings(things as readonly Json[]) } : work;
}

/** `[name, score, counts, lately]`. */
function readWork(words: Json | undefined, things: readonly Point[]): Work | undefined {
  if (!Array.isArray(words)) return undefined;
  const [name, score, counts, lately] = words as readonly Json[];
  const read = {
    name: readText(name, LONGEST),
    score: readNumber(score, -MOST_SCORE, MOST_SCORE),
    counts: readText(counts, LONGEST),
    lately_s: readNumber(lately, 1, MOST_S),
  };
  const isScored = read.score !== undefined || score === null;
  if (read.name === undefined || read.counts === undefined || !isScored || read.lately_s === undefined) {
    return undefined;
  }
  return { name: read.name, score: read.score, counts: read.counts, lately_s: read.lately_s, things };
}

function readThings(words: readonly Json[]): readonly Point[] {
  return words.slice(0, MOST_THINGS).flatMap((place) => {
    const [x, y] = Array.isArray(place) ? (place as readonly Json[]) : [];
    return readPointXy(x, y) ?? [];
  });
}
