// Read numbers, names and points from untrusted values of a peer.
//
// Every reader returns a drawable value or undefined: never NaN, never more than fits a screen or memory.

import { isObject, type Json, type JsonObject } from "./core/json";
import type { Point } from "./trail";

const FURTHEST = 1e7;

export function readNumber(word: unknown, least: number, most: number): number | undefined {
  return typeof word === "number" && word >= least && word <= most ? word : undefined;
}

export function readPointXy(x: unknown, y: unknown): Point | undefined {
  const checkedX = readNumber(x, -FURTHEST, FURTHEST);
  const checkedY = readNumber(y, -FURTHEST, FURTHEST);
  return checkedX === undefined || checkedY === undefined ? undefined : { x: checkedX, y: checkedY };
}

export function readPoint(words: Json | undefined): Point | undefined {
  return isObject(words) ? readPointXy(words["x"], words["y"]) : undefined;
}

/** A peer's text in displayable form; undefined if nothing is left. */
export function readText(word: unknown, longest: number): string | undefined {
  if (typeof word !== "string") return undefined;
  // Control characters break lines; direction marks can make a name look like another robot's.
  const shown = word.replace(/[\p{C}\u2028\u2029]/gu, "").trim();
  return shown === "" ? undefined : Array.from(shown).slice(0, longest).join("");
}

/** The objects in a list; none if it is not a list. */
export function objectsOf(words: Json | undefined): readonly JsonObject[] {
  return Array.isArray(words) ? (words as readonly Json[]).filter(isObject) : [];
}
