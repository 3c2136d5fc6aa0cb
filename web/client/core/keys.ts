// From a pin to a topic and a key (Qrkey §III-D).

import { hkdf } from "@noble/hashes/hkdf.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { encodeBase64url } from "./base64url";
import type { Pin } from "./pin";

// A protocol version of its own, taken by the published packages from their own version's first two numbers.
const TOPIC_INFO = "secret_topic_0.12";
const KEY_INFO = "secret_key_0.12";
const TOPIC_BYTES = 16;
const KEY_BYTES = 32;

const ascii = new TextEncoder();

/** 32 bytes of AES-256 key. Printing one, or putting it into JSON, gives `<Key>`. */
export class Key {
  readonly #raw: Uint8Array;

  constructor(raw: Uint8Array) {
    this.#raw = raw;
  }

  reveal(): Uint8Array {
    return this.#raw;
  }

  toString(): string {
    return "<Key>";
  }

  toJSON(): string {
    return "<Key>";
  }
}

/** A pin with what is derived from it. The topic is public: every message travels under it. */
export interface Epoch {
  readonly pin: Pin;
  readonly topic: string;
  readonly key: Key;
}

/** Source: Qrkey §III-D; the info strings are those of the published packages. */
export function deriveEpoch(pin: Pin): Epoch {
  const secret = ascii.encode(pin.reveal());
  const topic = hkdf(sha256, secret, undefined, ascii.encode(TOPIC_INFO), TOPIC_BYTES);
  const key = hkdf(sha256, secret, undefined, ascii.encode(KEY_INFO), KEY_BYTES);
  return { pin, topic: `${encodeBase64url(topic)}==`, key: new Key(key) };
}
