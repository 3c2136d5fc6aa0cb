// Derivations from the secret of an invitation, a room code or a resume: psk, id, MAC and topics.
//
// Only this file contains the labels of derivations.

import { hkdf } from "@noble/hashes/hkdf.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { concatBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import { encodeBase64url } from "../core/base64url";
import type { Cipher } from "./noise";
import { PROLOGUE, VERSION } from "./records";

export const PROTOCOL = "phalanx/1 ";
/** Of a psk, of an X25519 key and of a cipher. */
export const KEY_BYTES = 32;
export const ID_BYTES = 8;
export const MAC1_BYTES = 16;
export const TOPIC_BYTES = 16;

/** Origin of a handshake's secret: the name is the info of its psk, the index its number in a first message. */
export const KINDS = ["", "open", "ticket", "room", "resume"] as const;
export type Kind = Exclude<(typeof KINDS)[number], "">;

/** A secret and its kind. Printing it, or encoding it as JSON, gives `<Secret>`. */
export class Secret {
  readonly kind: Kind;
  readonly #raw: Uint8Array;

  constructor(kind: Kind, raw: Uint8Array) {
    this.kind = kind;
    this.#raw = raw;
  }

  /** Only for storage. */
  reveal(): Uint8Array {
    return this.#raw.slice();
  }

  toString(): string {
    return "<Secret>";
  }

  toJSON(): string {
    return "<Secret>";
  }

  /** Number of its kind, in a first message. */
  get number(): number {
    return KINDS.indexOf(this.kind);
  }

  get psk(): Uint8Array {
    return derive(this.#raw, this.kind, KEY_BYTES);
  }

  /** Its id in the first message; zeros for a room code, which could be searched offline by its id. */
  get id(): Uint8Array {
    return this.kind === "room" ? new Uint8Array(ID_BYTES) : derive(this.#raw, "id", ID_BYTES);
  }

  /** MAC of a first message on a broker. */
  mac1(hello: Uint8Array): Uint8Array {
    return hmac(sha256, derive(this.#raw, "mac1", KEY_BYTES), hello).slice(0, MAC1_BYTES);
  }

  /** Topic of the answer to a first message on a broker. */
  acceptTopic(hello: Uint8Array): string {
    return encodeBase64url(derive(concatBytes(this.#raw, hello), "accept", TOPIC_BYTES));
  }
}

/** HKDF-SHA256 without salt, info `phalanx/1 <purpose>`. */
export function derive(secret: Uint8Array, purpose: string, length: number): Uint8Array {
  return hkdf(sha256, secret, undefined, utf8ToBytes(PROTOCOL + purpose), length);
}

/** The prologue of a handshake: each field with its length. */
export function prologue(secret: Secret, root: string, broker: string): Uint8Array {
  return PROLOGUE.encode({
    version: Uint8Array.of(VERSION),
    kind: Uint8Array.of(secret.number),
    id: secret.id,
    root: utf8ToBytes(root),
    broker: utf8ToBytes(broker),
  });
}

/** Topic of first messages to a swarm on a broker. */
export function helloTopic(fixed: Uint8Array): string {
  return encodeBase64url(derive(fixed, "hello", TOPIC_BYTES));
}

/** Topic of the records of one direction and generation on a broker. */
export function recordTopic(cipher: Cipher): string {
  return encodeBase64url(cipher.derive(utf8ToBytes(`${PROTOCOL}topic`), TOPIC_BYTES));
}
