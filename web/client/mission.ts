// Missions: robots' progress, decoded landmarks, and the number still encoded (docs/spec/vocabulary.md).

import type { Json, JsonObject } from "./core/json";
import { readNumber, readPointXy, readText } from "./reading";
import type { Point } from "./trail";

export const PHASES = ["waiting", "seeking", "returning", "held", "done"] as const;
export type Phase = (typeof PHASES)[number];

/**
 * A robot's measured odometry errors: distance and turns in thousandths, and drift to the left per metre in hundredths of
 * a degree.
 */
export type Drift = readonly [way: number, turn: number, curve: number];

/** A robot's progress. */
export interface Walk {
  readonly phase: Phase;
  readonly decoded: number;
  readonly of: number;
  /** Why it went back or stopped, or "". */
  readonly why: string;
  readonly drift: Drift;
}

/** A landmark that a robot has decoded. */
export interface Lit extends Point {
  readonly type: string;
}

/** x, y of both ends. */
export type Wall = readonly [number, number, number, number];

/** The running mission: its number of nodes, and how many are not decoded yet. */
export interface Progress {
  readonly id: string;
  readonly nodes: number;
  readonly left: number;
}

/** State of robots on missions. */
export interface Missions {
  /** Undefined until received. */
  readonly walls: readonly Wall[] | undefined;
  /** Undefined before the first mission. */
  readonly progress: Progress | undefined;
  readonly lit: readonly Lit[];
}

const MOST_WALLS = 20_000;
const MOST_LIT = 5000;
const MOST_NODES = 1 << 20;
const LONGEST_WHY = 48;
const MOST_DRIFT = 99_999;
const LONGEST_ID = 64;
const LONGEST_TYPE = 24;

/** From the answer to request 1; undefined if robots have no missions. */
export function readMissions(words: JsonObject, before: Missions | undefined): Missions | undefined {
  if (readNumber(words["walls"], 0, Number.MAX_SAFE_INTEGER) === undefined) return undefined;
  const told = readProgress(words["mission"]);
  // If it is another mission than the known one, the next update says so and the landmarks are cleared.
  const progress = before?.progress && told?.id !== before.progress.id ? before.progress : told;
  return { walls: before?.walls, lit: before?.lit ?? [], progress };
}

/** `[id, nodes, left]`. */
export function readProgress(words: Json | undefined): Progress | undefined {
  const [idWord, nodesWord, leftWord] = rowOf(words);
  const id = readText(idWord, LONGEST_ID);
  const nodes = readCount(nodesWord);
  const left = readCount(leftWord);
  return id === undefined || nodes === undefined || left === undefined ? undefined : { id, nodes, left };
}

/** `[phase, decoded, of, why, drift]`. */
export function readWalk(words: Json | undefined): Walk | undefined {
  const [phaseWord, decodedWord, ofWord, why, drift] = rowOf(words);
  const phase = PHASES.find((each) => each === phaseWord);
  const decoded = readCount(decodedWord);
  const of = readCount(ofWord);
  if (phase === undefined || decoded === undefined || of === undefined) return undefined;
  return { phase, decoded, of, why: readText(why, LONGEST_WHY) ?? "", drift: readDrift(drift) };
}

/** `[way, turn, curve]`; zeros if malformed or missing. */
export function readDrift(words: Json | undefined): Drift {
  const [way, turn, curve] = rowOf(words).map((word) => readNumber(word, -MOST_DRIFT, MOST_DRIFT));
  return [way ?? 0, turn ?? 0, curve ?? 0];
}

/** The answer to request 2: `[[x, y, x, y], …]`. */
export function readWalls(words: Json): readonly Wall[] | undefined {
  if (!Array.isArray(words)) return undefined;
  return (words as readonly Json[]).slice(0, MOST_WALLS).flatMap((row) => {
    const [ax, ay, bx, by] = rowOf(row);
    const [a, b] = [readPointXy(ax, ay), readPointXy(bx, by)];
    return a && b ? [[a.x, a.y, b.x, b.y] as const] : [];
  });
}

/** `known` and new entries of `words`: the answer to request 3 and updates can overlap. */
export function withLit(known: readonly Lit[], words: Json | undefined): readonly Lit[] {
  if (!Array.isArray(words) || words.length === 0) return known;
  const seen = new Set(known.map(keyOf));
  const lit = [...known];
  for (const row of (words as readonly Json[]).slice(0, MOST_LIT)) {
    const [x, y, type] = rowOf(row);
    const at = readPointXy(x, y);
    if (!at || lit.length >= MOST_LIT) continue;
    const one = { ...at, type: readText(type, LONGEST_TYPE) ?? "" };
    if (seen.has(keyOf(one))) continue;
    seen.add(keyOf(one));
    lit.push(one);
  }
  return lit.length === known.length ? known : lit;
}

/** The mission in an update; `another` if it is a new one. */
export function missionsInFrame(missions: Missions, frame: JsonObject): { missions: Missions; another: boolean } {
  const told = Array.isArray(frame["mission"]) ? readProgress((frame["mission"] as readonly Json[])[0]) : undefined;
  const another = told !== undefined && told.id !== missions.progress?.id;
  const lit = withLit(another ? [] : missions.lit, frame["lit"]);
  if (told === undefined && lit === missions.lit) return { missions, another };
  return { missions: { ...missions, lit, progress: told ?? missions.progress }, another };
}

function keyOf({ x, y, type }: Lit): string {
  return `${x} ${y} ${type}`;
}

function readCount(word: unknown): number | undefined {
  const number = readNumber(word, 0, MOST_NODES);
  return number !== undefined && Number.isInteger(number) ? number : undefined;
}

function rowOf(words: Json | undefined): readonly Json[] {
  return Array.isArray(words) ? (words as readonly Json[]) : [];
}
