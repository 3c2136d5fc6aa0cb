// Where robots are, as frames tell it: six bytes for each (docs/spec/vocabulary.md#places).

import { decodeBase64url } from "./core/base64url";
import type { Json } from "./core/json";
import { readNumber } from "./robot";

export interface Place {
  readonly number: number;
  readonly x: number;
  readonly y: number;
  /** Whole degrees. */
  readonly direction: number;
}

const RECORD_BYTES = 6;
const TURN_DEG = 360;
/** In the place of so many skipped numbers: they are skipped, and the record is no robot. */
const NOBODY = 181;
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
  if (typeof text !== "string" || text.length > (MOST_RECORDS * RECORD_BYTES * 4) / 3) return;
  const raw = decodeBase64url(encoder.encode(text));
  if (!raw || raw.length % RECORD_BYTES !== 0) return;
  const record = new DataView(raw.buffer, raw.byteOffset, raw.length);
  let number = first;
  for (let at = 0; at < raw.length; at += RECORD_BYTES) {
    const word = record.getUint16(at, true);
    const skipped = Math.min(NOBODY, Math.floor(word / TURN_DEG));
    number += skipped;
    if (skipped === NOBODY) continue;
    places.push({
      number,
      x: left + step * record.getUint16(at + 2, true),
      y: top + step * record.getUint16(at + 4, true),
      direction: word % TURN_DEG,
    });
    number += 1;
  }
}
