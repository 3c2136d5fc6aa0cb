// Pad plaintexts to few sizes, so that a record's length does not reveal its kind, such as turn or stop.

import { TooLarge, UsageError } from "../core/errors";
import { MalformedRecord } from "./layout";
import { PADDED } from "./records";

const SMALL = [128, 512];
const STEP = 2048;

/** Size of the padded plaintext for content of this length. */
export function paddedSize(length: number): number {
  const whole = length + PADDED.size;
  return SMALL.find((size) => whole <= size) ?? Math.ceil(whole / STEP) * STEP;
}

/** @throws UsageError: longer than `most` bytes with padding. */
export function pad(content: Uint8Array, most: number): Uint8Array {
  const size = paddedSize(content.length);
  if (size > most) throw new UsageError(`message of ${content.length} bytes, limit ${most - PADDED.size}`);
  const filled = new Uint8Array(size - PADDED.size);
  filled.set(content);
  return PADDED.encode({ length: content.length, content: filled });
}

/** @throws MalformedRecord: not the size of padded content, or invalid padding. */
export function unpad(plaintext: Uint8Array): Uint8Array {
  const { length, content } = PADDED.decode(plaintext);
  const wrong = length > content.length || paddedSize(length) !== plaintext.length;
  if (wrong || content.subarray(length).some((byte) => byte !== 0)) throw new MalformedRecord("not padded as it should be");
  return content.slice(0, length);
}

/** @throws TooLarge */
export function checkSize(raw: Uint8Array, most: number): void {
  if (raw.length > most) throw new TooLarge(`${raw.length} bytes, limit ${most}`);
}
