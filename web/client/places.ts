// Where robots are, as frames tell it: six bytes for each (docs/spec/vocabulary.md#places).

import { decodeBase64url } from "./core/base64url";
import type { Json } from "./core/json";
import { readNumber } from "./reading";
import { PASS_BY, PLACE, TURN_DEG } from "./wire";

export interface Place {
  readonly number: number;
  readonly x: number;
  readonly y: number;
  /** Whole degrees. */
  readonly direction: number;
}

/** Ten frames of ours. */
const MOST_RECORDS = 4000;
const MOST_PIECES = 100;
const FARTHEST = 1e9;

const encoder = new TextEncoder();

/** Those that `words` tell, piece by piece; nothing of a piece that is none. */
export function readPlaces(words: Json | undefined): readonly Place[] {
  if (!Array.isArray(words)) return [];
  const places: Place[] = [];
  for (const piece of (words as readonly Json[]).slice(0, MOST_PIECES)) {
    readPiece(piece, places);
    if (places.length > MOST_RECORDS) break;
  }
  return places;
}

function readPiece(words: Json, places: Place[]): void {
  if (!Array.isArray(words)) return;
  const [first, left, top, step] = (words as readonly Json[]).slice(0, 4).map((word) => readNumber(word, -FARTHEST, FARTHEST));
  const text = (words as readonly Json[])[4];
  if (first === undefined || left === undefined || top === undefined || step === undefined) return;
  if (typeof text !== "string" || text.length > (MOST_RECORDS * PLACE.bytes * 4) / 3) return;
  const raw = decodeBase64url(encoder.encode(text));
  if (!raw || raw.length % PLACE.bytes !== 0) return;
  const record = new DataView(raw.buffer, raw.byteOffset, raw.length);
  let number = first;
  for (let at = 0; at < raw.length; at += PLACE.bytes) {
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
