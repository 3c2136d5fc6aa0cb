// Codec of the byte table's records: little-endian, no padding, lengths before contents, no trailing bytes.
//
// Only this file converts between values and bytes; records.ts, generated from the table, lists the records.

import { PeerError, UsageError } from "../core/errors";

/** A record is too short, too long, of another tag, or has an invalid value. */
export class MalformedRecord extends PeerError {
  override readonly reason = "malformed_record";
  override readonly name = "MalformedRecord";
}

/** u8 to u64, bN: N bytes, v8 and v16: a length and as many bytes, rest: all remaining bytes. */
export type FieldType = "u8" | "u16" | "u32" | "u64" | "v8" | "v16" | "rest" | `b${number}`;
type Value = number | Uint8Array;

const WIDTHS: Readonly<Record<string, number>> = { u8: 1, u16: 2, u32: 4, u64: 8, v8: 1, v16: 2, rest: 0 };
const BYTE = 256;

function widthOf(type: FieldType): number {
  return WIDTHS[type] ?? Number(type.slice(1));
}

export interface Layout<T> {
  readonly name: string;
  /** The first byte; undefined for a record without one. */
  readonly tag: number | undefined;
  /** Bytes, without the contents of a v8, v16 or rest. */
  readonly size: number;
  /** @throws UsageError: a value does not fit. */
  encode(values: T): Uint8Array;
  /** @throws MalformedRecord */
  decode(raw: Uint8Array): T;
}

/** A record of these fields, in this order. */
export function layout<T>(name: string, tag: number | undefined, fields: { readonly [K in keyof T]: FieldType }): Layout<T> {
  const entries = Object.entries<FieldType>(fields);
  const head = tag === undefined ? 0 : 1;
  const size = entries.reduce((sum, [, type]) => sum + widthOf(type), head);

  function encode(values: T): Uint8Array {
    const out: number[] = tag === undefined ? [] : [tag];
    const pieces: Uint8Array[] = [];
    const flush = (): void => {
      pieces.push(Uint8Array.from(out));
      out.length = 0;
    };
    for (const [key, type] of entries) {
      const value = (values as Readonly<Record<string, Value>>)[key];
      if (typeof value === "number") putNumber(out, value, widthOf(type), `${name}: ${key}`);
      else if (value instanceof Uint8Array) {
        const width = widthOf(type);
        if (type.startsWith("v")) putNumber(out, value.length, width, `${name}: ${key}`);
        else if (type !== "rest" && value.length !== width) throw new UsageError(`${name}: ${key} has ${value.length} bytes`);
        flush();
        pieces.push(value);
      } else throw new UsageError(`${name}: ${key} is missing`);
    }
    flush();
    return joined(pieces);
  }

  function decode(raw: Uint8Array): T {
    if (raw.length < size || (tag !== undefined && raw[0] !== tag)) throw new MalformedRecord(`not a ${name}`);
    const values: Record<string, Value> = {};
    let at = head;
    for (const [key, type] of entries) {
      let width = widthOf(type);
      if (type.startsWith("u")) values[key] = numberAt(raw, at, width, name);
      else {
        if (type.startsWith("v")) {
          const length = numberAt(raw, at, width, name);
          at += width;
          width = length;
        } else if (type === "rest") width = raw.length - at;
        if (at + width > raw.length) throw new MalformedRecord(`${name}: ends inside ${key}`);
        values[key] = raw.slice(at, at + width);
      }
      at += width;
    }
    if (at !== raw.length) throw new MalformedRecord(`${name}: ${raw.length - at} bytes too many`);
    return values as T;
  }

  return { name, tag, size, encode, decode };
}

function putNumber(out: number[], value: number, width: number, what: string): void {
  if (!Number.isSafeInteger(value) || value < 0 || value >= BYTE ** width) throw new UsageError(`${what} does not fit`);
  for (let rest = value, i = 0; i < width; i += 1, rest = Math.floor(rest / BYTE)) out.push(rest % BYTE);
}

/** Inexact above 2^53, which is more than any accepted counter. */
function numberAt(raw: Uint8Array, at: number, width: number, name: string): number {
  if (at + width > raw.length) throw new MalformedRecord(`${name}: ends inside a number`);
  let value = 0;
  for (let i = width - 1; i >= 0; i -= 1) value = value * BYTE + (raw[at + i] ?? 0);
  return value;
}

function joined(pieces: readonly Uint8Array[]): Uint8Array {
  const made = new Uint8Array(pieces.reduce((sum, piece) => sum + piece.length, 0));
  let at = 0;
  for (const piece of pieces) {
    made.set(piece, at);
    at += piece.length;
  }
  return made;
}
