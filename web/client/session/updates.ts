// State updates, read by a visitor: encrypted once for all, signed by the swarm, each under its own key from a hash
// chain, so that a visitor who receives the chain at an update can read that one and later ones.

import { ed25519 } from "@noble/curves/ed25519.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { utf8ToBytes } from "@noble/hashes/utils.js";
import { NotAuthentic, Replayed } from "../core/errors";
import { CLIENT_MAX_BYTES } from "./channel";
import { UnknownEpoch } from "./errors";
import { Cipher } from "./noise";
import { checkSize, unpad } from "./padding";
import { type EpochFields, SIGNED_UPDATE, TAG_BYTES, UPDATE, UPDATE_HEAD } from "./records";
import { PROTOCOL } from "./secret";
import { COUNTER_LIMIT } from "./window";

export const DIGEST_BYTES = 8;
/** Most updates that a client may have missed. */
export const SKIP_LIMIT = 20_000;
const EPOCHS_KEPT = 2;
const KEY = utf8ToBytes(`${PROTOCOL}update`);
const NEXT = utf8ToBytes(`${PROTOCOL}chain`);

/** Advance the chain key; earlier keys cannot be derived from it. */
function advanced(chain: Uint8Array, steps: number): Uint8Array {
  let key = chain;
  for (let i = 0; i < steps; i += 1) key = hmac(sha256, key, NEXT);
  return key;
}

/** The digest by which a command refers to an update. */
export function digestOf(update: Uint8Array): Uint8Array {
  return sha256(update).slice(0, DIGEST_BYTES);
}

export class UpdateReader {
  /** Counter of the newest update, and its digest: for commands. */
  seen = 0;
  digest: Uint8Array = new Uint8Array(DIGEST_BYTES);
  readonly #signer: Uint8Array;
  #chains: readonly EpochFields[] = [];

  /** `signer` is the swarm's Ed25519 public key. */
  constructor(signer: Uint8Array) {
    this.#signer = signer;
  }

  /** Add the key of an epoch, from a session. Only the newest two are kept. */
  learn(epoch: EpochFields): void {
    const known = this.#chains.find((each) => each.epoch === epoch.epoch);
    if (known && known.counter >= epoch.counter) return;
    const others = this.#chains.filter((each) => each.epoch !== epoch.epoch);
    this.#chains = [...others, epoch].sort((a, b) => a.epoch - b.epoch).slice(-EPOCHS_KEPT);
  }

  /** Topics of updates on a broker. */
  topics(): readonly Uint8Array[] {
    return this.#chains.map((each) => each.topic);
  }

  /** Decrypt an update; a refused one changes nothing. @throws PeerError */
  open(raw: Uint8Array): Uint8Array {
    checkSize(raw, UPDATE.size + CLIENT_MAX_BYTES + TAG_BYTES);
    const { epoch, counter, signature, sealed } = UPDATE.decode(raw);
    const chain = this.#chains.find((each) => each.epoch === epoch);
    if (chain === undefined) throw new UnknownEpoch("an update of an epoch whose key is not here");
    if (counter <= this.seen || counter < chain.counter) throw new Replayed(`update ${counter}, newest ${this.seen}`);
    if (counter - chain.counter > SKIP_LIMIT || counter >= COUNTER_LIMIT) throw new UnknownEpoch("an update too far ahead");
    // Checked before the chain is advanced, which costs a hash per missed update.
    this.#verify(signature, SIGNED_UPDATE.encode({ epoch, counter, sealed }));
    const key = advanced(chain.chain, counter - chain.counter);
    const cipher = new Cipher(hmac(sha256, key, KEY));
    const state = unpad(cipher.open(counter, sealed, UPDATE_HEAD.encode({ epoch, counter })));
    const next = { ...chain, counter: counter + 1, chain: advanced(key, 1) };
    this.#chains = [next, ...this.#chains.filter((each) => each.epoch > epoch)];
    this.seen = counter;
    this.digest = digestOf(raw);
    return state;
  }

  #verify(signature: Uint8Array, signed: Uint8Array): void {
    let valid: boolean;
    try {
      valid = ed25519.verify(signature, signed, this.#signer, { zip215: false });
    } catch {
      valid = false;
    }
    if (!valid) throw new NotAuthentic("the signature does not verify");
  }
}
