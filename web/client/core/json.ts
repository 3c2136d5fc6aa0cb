// JSON from a peer: parsed strictly, and typed so that nothing is used before validation.

import { BadPayload } from "./errors";

export type Json = null | boolean | number | string | readonly Json[] | JsonObject;
export interface JsonObject {
  readonly [key: string]: Json | undefined;
}

// The vocabulary nests six deep. Parsers have different limits, and some overflow the stack instead of refusing.
const DEEPEST = 200;

// ignoreBOM keeps the mark in the text, where JSON.parse refuses it, as other languages' parsers do.
const utf8 = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });

/** Parse `plaintext`. @throws BadPayload: not UTF-8, not JSON, nested too deep. */
export function parseJson(plaintext: Uint8Array): Json {
  try {
    const text = utf8.decode(plaintext);
    refuseDepthAndTwins(text);
    return JSON.parse(text) as Json;
  } catch {
    // JSON.parse quotes its input: that message must not be passed on.
    throw new BadPayload("not JSON");
  }
}

export function isObject(value: unknown): value is JsonObject {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** Refuse deep nesting and duplicate keys, which JSON.parse would accept. */
function refuseDepthAndTwins(text: string): void {
  const open: Set<string>[] = [];
  let from = 0;
  let word = "";
  let inString = false;
  for (let i = 0; i < text.length; i += 1) {
    const code = text.charCodeAt(i);
    if (inString) {
      if (code === 0x5c) i += 1;
      else if (code === 0x22) {
        inString = false;
        word = text.slice(from, i + 1);
      }
    } else if (code === 0x22) {
      inString = true;
      from = i;
    } else if (code === 0x5b || code === 0x7b) {
      open.push(new Set());
      if (open.length > DEEPEST) throw new BadPayload("nested too deep");
    } else if (code === 0x5d || code === 0x7d) open.pop();
    else if (code === 0x3a) {
      const key = word.includes("\\") ? String(JSON.parse(word)) : word.slice(1, -1);
      const keys = open.at(-1);
      if (keys?.has(key)) throw new BadPayload("a key twice");
      keys?.add(key);
    }
  }
}
