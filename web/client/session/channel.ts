// Records of one session at a client: encrypted with the newest keys, decrypted with those of two generations.

import { NotAuthentic, UsageError } from "../core/errors";
import type { Cipher, Keys } from "./noise";
import { checkSize, pad, unpad } from "./padding";
import { RECORD, RECORD_HEAD, TAG_BYTES } from "./records";
import { COUNTER_LIMIT, Window } from "./window";

/** Longest plaintext of a record, with its padding, to a server and to a client. */
export const SERVER_MAX_BYTES = 16 * 1024;
export const CLIENT_MAX_BYTES = 1024 * 1024;
/** Time for which the previous keys are accepted once the server uses the new ones. */
export const OVERLAP_MS = 10_000;

interface Generation {
  readonly number: number;
  readonly keys: Keys;
  readonly made_ms: number;
  readonly received: Window;
  sent: number;
  /** When these keys expire for received records. */
  until_ms: number | undefined;
}

/** A message of the server. */
export interface Opened {
  readonly content: Uint8Array;
  /** No later record was opened before. */
  readonly inOrder: boolean;
}

/** The keys of a client, and the counters. */
export class Channel {
  #now: Generation | undefined;
  #before: Generation | undefined;

  get isOpen(): boolean {
    return this.#now !== undefined;
  }

  /** When the current keys were made. */
  get made_ms(): number {
    return this.#now?.made_ms ?? 0;
  }

  /** Ciphers of received records: topics on a broker are derived from them. */
  receiveCiphers(): Cipher[] {
    return [this.#now, this.#before].flatMap((each) => (each ? [each.keys.toClient] : []));
  }

  /** Cipher of the next record to send. @throws UsageError: there are no keys yet. */
  sendCipher(): Cipher {
    return this.#used().keys.toServer;
  }

  /** Use these keys from now on. The previous ones are accepted until the server uses the new ones, and a while longer. */
  adopt(number: number, keys: Keys, now_ms: number): void {
    this.#before = this.#now;
    this.#now = { number, keys, made_ms: now_ms, received: new Window(), sent: 0, until_ms: undefined };
  }

  /** Drop the previous keys once they have expired. */
  expire(now_ms: number): void {
    if (this.#before?.until_ms !== undefined && now_ms >= this.#before.until_ms) this.#before = undefined;
  }

  /** Encrypt a message into a record. @throws UsageError: too long, or there are no keys yet. */
  seal(content: Uint8Array): Uint8Array {
    const used = this.#used();
    const plaintext = pad(content, SERVER_MAX_BYTES);
    if (used.sent >= COUNTER_LIMIT) throw new UsageError("a session's counter is used up");
    const head = { generation: used.number, counter: used.sent };
    used.sent += 1;
    return RECORD.encode({ ...head, sealed: used.keys.toServer.seal(head.counter, plaintext, RECORD_HEAD.encode(head)) });
  }

  /** Decrypt a record of the server. @throws TooLarge, MalformedRecord, NotAuthentic, Replayed */
  open(raw: Uint8Array, now_ms: number): Opened {
    checkSize(raw, RECORD.size + CLIENT_MAX_BYTES + TAG_BYTES);
    const { generation, counter, sealed } = RECORD.decode(raw);
    this.expire(now_ms);
    const used = [this.#now, this.#before].find((each) => each?.number === generation);
    if (used === undefined) throw new NotAuthentic("keys of no generation in use");
    used.received.check(counter);
    const content = unpad(used.keys.toClient.open(counter, sealed, RECORD_HEAD.encode({ generation, counter })));
    const inOrder = used === this.#now && used.received.isNewest(counter);
    used.received.enter(counter);
    if (used === this.#now && this.#before) this.#before.until_ms ??= now_ms + OVERLAP_MS;
    return { content, inOrder };
  }

  #used(): Generation {
    if (this.#now === undefined) throw new UsageError("a session without keys");
    return this.#now;
  }
}
