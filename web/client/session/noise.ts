// Noise_NKpsk0_25519_ChaChaPoly_SHA256: the client's half of the handshake, and the resulting ciphers.
//
// Source: The Noise Protocol Framework, revision 34. noble instead of WebCrypto, which browsers disable on http:// pages.

import { chacha20poly1305 } from "@noble/ciphers/chacha.js";
import { x25519 } from "@noble/curves/ed25519.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { concatBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import { NotAuthentic } from "../core/errors";
import { KEY_BYTES } from "./secret";

const NAME = utf8ToBytes("Noise_NKpsk0_25519_ChaChaPoly_SHA256");
const NONCE_BYTES = 12;
const NONCE_ZEROS = 4;
const EMPTY_BYTES = KEY_BYTES + 16;
const NONE = new Uint8Array(0);

/** The key of one direction; the caller counts. Printing it reveals nothing. */
export class Cipher {
  readonly #key: Uint8Array;

  constructor(key: Uint8Array) {
    this.#key = key;
  }

  /** No counter may be used twice. */
  seal(counter: number, plaintext: Uint8Array, associated: Uint8Array): Uint8Array {
    return chacha20poly1305(this.#key, nonce(counter), associated).encrypt(plaintext);
  }

  /** @throws NotAuthentic */
  open(counter: number, sealed: Uint8Array, associated: Uint8Array): Uint8Array {
    try {
      return chacha20poly1305(this.#key, nonce(counter), associated).decrypt(sealed);
    } catch {
      throw new NotAuthentic("the tag does not verify");
    }
  }

  /** Bytes derived from the key, for a purpose other than sealing. */
  derive(info: Uint8Array, length: number): Uint8Array {
    return hmac(sha256, this.#key, info).slice(0, length);
  }
}

/** The two directions of a session, and the hash of their handshake. */
export interface Keys {
  readonly toServer: Cipher;
  readonly toClient: Cipher;
  readonly handshakeHash: Uint8Array;
}

/** SymmetricState of Noise: immutable, so that a forged message changes nothing. */
class State {
  readonly hash: Uint8Array;
  readonly #chaining: Uint8Array;
  readonly #key: Uint8Array;

  constructor(hash: Uint8Array, chaining: Uint8Array, key: Uint8Array) {
    this.hash = hash;
    this.#chaining = chaining;
    this.#key = key;
  }

  mixHash(data: Uint8Array): State {
    return new State(sha256(concatBytes(this.hash, data)), this.#chaining, this.#key);
  }

  mixKey(material: Uint8Array): State {
    const [chaining, key] = hkdf(this.#chaining, material);
    return new State(this.hash, chaining, key);
  }

  mixPsk(psk: Uint8Array): State {
    const [chaining, extra, key] = hkdf(this.#chaining, psk);
    return new State(this.hash, chaining, key).mixHash(extra);
  }

  /** Also mixed into the key, for the psk: Noise §9.2. */
  mixEphemeral(key: Uint8Array): State {
    return this.mixHash(key).mixKey(key);
  }

  seal(payload: Uint8Array): { state: State; sealed: Uint8Array } {
    const sealed = new Cipher(this.#key).seal(0, payload, this.hash);
    return { state: this.mixHash(sealed), sealed };
  }

  open(sealed: Uint8Array): { state: State; payload: Uint8Array } {
    const payload = new Cipher(this.#key).open(0, sealed, this.hash);
    return { state: this.mixHash(sealed), payload };
  }

  split(): Keys {
    const [toServer, toClient] = hkdf(this.#chaining, NONE);
    return { toServer: new Cipher(toServer), toClient: new Cipher(toClient), handshakeHash: this.hash };
  }
}

/** The client's half: it has the server's static public key and the psk. `ephemeral`: 32 random bytes, used once. */
export class Initiator {
  readonly #ephemeral: Uint8Array;
  readonly #fixed: Uint8Array;
  #state: State;

  constructor(prologue: Uint8Array, fixed: Uint8Array, psk: Uint8Array, ephemeral: Uint8Array) {
    const name = sha256(NAME);
    this.#state = new State(name, name, NONE).mixHash(prologue).mixHash(fixed).mixPsk(psk);
    this.#ephemeral = ephemeral;
    this.#fixed = fixed;
  }

  /** The first message. @throws NotAuthentic: the server's key is a point of low order. */
  write(payload: Uint8Array = NONE): Uint8Array {
    const own = x25519.getPublicKey(this.#ephemeral);
    const { state, sealed } = this.#state.mixEphemeral(own).mixKey(exchange(this.#ephemeral, this.#fixed)).seal(payload);
    this.#state = state;
    return concatBytes(own, sealed);
  }

  /** Payload of the second message, and the keys; a refused message changes nothing. @throws NotAuthentic */
  read(message: Uint8Array): { payload: Uint8Array; keys: Keys } {
    if (message.length < EMPTY_BYTES) throw new NotAuthentic(`a handshake message of ${message.length} bytes`);
    const theirs = message.slice(0, KEY_BYTES);
    const mixed = this.#state.mixEphemeral(theirs).mixKey(exchange(this.#ephemeral, theirs));
    const { state, payload } = mixed.open(message.slice(KEY_BYTES));
    return { payload, keys: state.split() };
  }
}

function hkdf(chaining: Uint8Array, material: Uint8Array): [Uint8Array, Uint8Array, Uint8Array] {
  const temporary = hmac(sha256, chaining, material);
  const first = hmac(sha256, temporary, Uint8Array.of(1));
  const second = hmac(sha256, temporary, concatBytes(first, Uint8Array.of(2)));
  return [first, second, hmac(sha256, temporary, concatBytes(second, Uint8Array.of(3)))];
}

function nonce(counter: number): Uint8Array {
  const made = new Uint8Array(NONCE_BYTES);
  new DataView(made.buffer).setBigUint64(NONCE_ZEROS, BigInt(counter), true);
  return made;
}

function exchange(own: Uint8Array, theirs: Uint8Array): Uint8Array {
  try {
    return x25519.getSharedSecret(own, theirs);
  } catch {
    throw new NotAuthentic("a public key of low order");
  }
}
