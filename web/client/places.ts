// Unpack robots' places, six bytes each, and routes from updates (docs/spec/vocabulary.md#places).

import { decodeBase64url } from "./core/base64url";
import type { Json } from "./core/json";
import { readNumber } from "./reading";
import type { Point } from "./trail";
import { PASS_BY, PLACE, POINT, TURN_DEG } from "./wire";

export interface Place {
  readonly number: number;
  readonly x: number;
  readonly y: number;
  /** Whole degrees. */
  readonly direction: number;
}

/** Ten updates of our gateway. */
const MOST_RECORDS = 4000;
const MOST_PIECES = 100;
const FARTHEST = 1e9;
/** 64 that a server accepts, and the robot's place at the start. */
export const MOST_WAYPOINTS = 65;

const encoder = new TextEncoder();

/** The places in `words`, group by group; malformed groups are skipped. */
export function readPlaces(words: Json | undefined): readonly Place[] {
  if (!Array.isArray(words)) return [];
  const places: Place[] = [];
  for (const piece of (words as readonly Json[]).slice(0, MOST_PIECES)) {
    readPiece(piece, places);
    if (places.length > MOST_RECORDS) break;
  }
  return places;
}

/** A route: its robot's number and its points. Undefined if malformed. */
export function readRoute(words: Json): { readonly number: number; readonly points: readonly Point[] } | undefined {
  const packed = unpacked(words, POINT.bytes, MOST_WAYPOINTS);
  if (!packed) return undefined;
  const { first, left, top, step, records } = packed;
  const points: Point[] = [];
  for (let at = 0; at < records.byteLength; at += POINT.bytes) {
    const x = left + step * records.getUint16(at + POINT.x, true);
    points.push({ x, y: top + step * records.getUint16(at + POINT.y, true) });
  }
  return { number: first, points };
}

interface Packed {
  readonly first: number;
  readonly left: number;
  readonly top: number;
  readonly step: number;
  readonly records: DataView;
}

/** `[first, left, top, step, records]`. */
function unpacked(words: Json, bytes: number, most: number): Packed | undefined {
  if (!Array.isArray(words)) return undefined;
  const [first, left, top, step] = (words as readonly Json[]).slice(0, 4).map((word) => readNumber(word, -FARTHEST, FARTHEST));
  const text = (words as readonly Json[])[4];
  if (first === undefined || left === undefined || top === undefined || step === undefined) return undefined;
  if (typeof text !== "string" || text.length > Math.ceil((most * bytes * 4) / 3)) return undefined;
  const raw = decodeBase64url(encoder.encode(text));
  if (!raw || raw.length % bytes !== 0) return undefined;
  return { first, left, top, step, records: new DataView(raw.buffer, raw.byteOffset, raw.length) };
}

function readPiece(words: Json, places: Place[]): void {
  const packed = unpacked(words, PLACE.bytes, MOST_RECORDS);
  if (!packed) return;
  const { first, left, top, step, records: record } = packed;
  let number = first;
  for (let at = 0; at < record.byteLength; at += PLACE.bytes) {
    const word = record.getUint16(at + PLACE.w, true);
    const skipped = Math.min(PASS_BY, Math.floor(word / TURN_DEG));
    number += skipped;
    if (skipped === PASS_BY) continue;
    places.push({
      number,
      x: left + step * record.getUint16(at + PLACE.x, true),
      y: top + step * record.getUint16(at + PLACE.y, true),
      direction: word % TURN_DEG,
    });
    number += 1;
  }
}
