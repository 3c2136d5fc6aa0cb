// A visitor's side of a session, the same as phalanx/link/session/client.py.
//
// Pure: bytes and a time in, events and bytes out; sockets, clocks and random bytes are in io. receive() never throws:
// refused input is counted by its reason and changes nothing.

import { concatBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import { encodeBase64url } from "../core/base64url";
import { PeerError, UsageError } from "../core/errors";
import { Channel } from "./channel";
import { type EndReason, type Reason, Unexpected } from "./errors";
import type { Invitation } from "./invitation";
import { decodeMessage, type ServerMessage, type Standing } from "./messages";
import { Initiator } from "./noise";
import { ACCEPT, ALIVE, COMMAND, type EpochFields, HELLO, JOIN, LEAVE, LINK_REQUEST, READY, RECORD, STORED, UPDATE } from "./records";
import { helloTopic, KEY_BYTES, prologue, recordTopic, type Secret } from "./secret";
import { UpdateReader } from "./updates";

/** Time limit from a first message to `welcome`. */
export const HANDSHAKE_MS = 5_000;
/** Age at which new keys are made. */
export const REKEY_MS = 600_000;
/** Interval of `alive` on a broker. */
export const ALIVE_MS = 4_000;
/** A broker does not report that the server is gone, or has forgotten us. Waiting visitors get no updates. */
const QUIET_MS = 5_000;
const QUIET_WAITING_MS = 60_000;
const EPOCHS_KEPT = 2;

export type SessionEvent =
  /** Send these bytes; on a broker, to this topic below the root. */
  | { readonly kind: "transmit"; readonly data: Uint8Array; readonly topic: string }
  /** On a broker: subscribe to these topics below the root only. */
  | { readonly kind: "hear"; readonly topics: readonly string[] }
  | { readonly kind: "admitted"; readonly visitor: number; readonly name: string }
  /** Store a secret to resume with, then call stored(). */
  | { readonly kind: "keep"; readonly secret: Secret; readonly lifetime_s: number }
  | { readonly kind: "stands"; readonly standing: Standing }
  | { readonly kind: "updated"; readonly state: Uint8Array }
  | { readonly kind: "replied"; readonly number: number; readonly payload: Uint8Array }
  | { readonly kind: "refused"; readonly number: number; readonly reason: Reason }
  /** Without a reason: no answer, or this side left. */
  | { readonly kind: "ended"; readonly reason: EndReason | undefined };

interface Handshake {
  readonly initiator: Initiator;
  readonly secret: Secret;
  readonly acceptTopic: string;
  readonly begun_ms: number;
}

export class Session {
  /** Refused messages, by reason. */
  readonly rejected = new Map<string, number>();
  readonly #invitation: Invitation;
  readonly #random: (length: number) => Uint8Array;
  readonly #name: string;
  readonly #onBroker: boolean;
  readonly #channel = new Channel();
  #secret: Secret;
  #handshake: Handshake | undefined;
  /** When waiting for `welcome` began. */
  #adopted_ms: number | undefined;
  #joined = false;
  #over = false;
  #signer = "";
  #reader: UpdateReader | undefined;
  #early: readonly EpochFields[] = [];
  /** A secret that arrived before `welcome`: it cannot be confirmed yet. */
  #earlySecret: readonly SessionEvent[] = [];
  #requests = 0;
  #said_ms = 0;
  #heard_ms = 0;
  #isWaiting = false;

  /** `random` returns n bytes from a cryptographic source; the server may choose another nickname. */
  constructor(invitation: Invitation, random: (length: number) => Uint8Array, name = "") {
    this.#invitation = invitation;
    this.#secret = invitation.secret;
    this.#onBroker = invitation.broker !== "";
    this.#random = random;
    this.#name = name;
  }

  /** Nothing is sent or read any more; a new session can resume. */
  get isOver(): boolean {
    return this.#over;
  }

  /** The server has admitted this visitor. */
  get isJoined(): boolean {
    return this.#joined && !this.#over;
  }

  /** An update was read: until then commands are late. */
  get hasSeen(): boolean {
    return (this.#reader?.seen ?? 0) > 0;
  }

  /** Begin a handshake: the first, or one for new keys. */
  start(now_ms: number): SessionEvent[] {
    const { fixed, root, broker } = this.#invitation;
    const secret = this.#secret;
    const initiator = new Initiator(prologue(secret, root, broker), fixed, secret.psk, this.#random(KEY_BYTES));
    const hello = HELLO.encode({ kind: secret.number, id: secret.id, noise: initiator.write() });
    const acceptTopic = this.#onBroker ? secret.acceptTopic(hello) : "";
    this.#handshake = { initiator, secret, acceptTopic, begun_ms: now_ms };
    if (!this.#onBroker) return [{ kind: "transmit", data: hello, topic: "" }];
    const signed = concatBytes(hello, secret.mac1(hello));
    return [...this.#hear(), { kind: "transmit", data: signed, topic: helloTopic(fixed) }];
  }

  /** Read data from the server. Never throws. */
  receive(raw: Uint8Array, now_ms: number): SessionEvent[] {
    if (this.#over) return [];
    try {
      if (raw[0] === RECORD.tag) return this.#record(raw, now_ms);
      if (raw[0] === UPDATE.tag) return this.#update(raw, now_ms);
      return this.#accept(raw, now_ms);
    } catch (error) {
      if (!(error instanceof PeerError)) throw error;
      this.rejected.set(error.reason, (this.rejected.get(error.reason) ?? 0) + 1);
      return [];
    }
  }

  /** Perform due actions; call it once a second, and first after sleep. */
  tick(now_ms: number): SessionEvent[] {
    if (this.#over) return [];
    const quiet_ms = now_ms - this.#heard_ms;
    if (this.isJoined && this.#onBroker && quiet_ms >= (this.#isWaiting ? QUIET_WAITING_MS : QUIET_MS)) return this.#end(undefined);
    this.#channel.expire(now_ms);
    const since = [this.#adopted_ms, this.#handshake?.begun_ms].filter((each) => each !== undefined);
    if (since.length > 0 && now_ms - Math.min(...since) >= HANDSHAKE_MS) {
      if (!this.#joined) return this.#end(undefined);
      if (now_ms - Math.max(...since) < 2 * HANDSHAKE_MS) return [];
      // The server has discarded the previous one.
      this.#adopted_ms = undefined;
      return this.start(now_ms);
    }
    if (this.#joined && since.length === 0 && now_ms - this.#channel.made_ms >= REKEY_MS) return this.start(now_ms);
    if (this.#joined && this.#onBroker && now_ms - this.#said_ms >= ALIVE_MS) return [this.#send(ALIVE.encode({}), now_ms)];
    return [];
  }

  /** Encode a command for one robot, based on the newest update. @throws UsageError: not joined, or too long. */
  command(robot: string, name: string, payload: Uint8Array, now_ms: number, stop = false): SessionEvent {
    const { seen, digest } = this.#ready();
    const words = { robot: utf8ToBytes(robot), name: utf8ToBytes(name), payload };
    return this.#send(COMMAND.encode({ stop: stop ? 1 : 0, seen, digest, ...words }), now_ms);
  }

  /** Encode a request, and return its number. @throws UsageError: not joined, or too long. */
  request(name: string, payload: Uint8Array, now_ms: number): { number: number; event: SessionEvent } {
    this.#ready();
    this.#requests += 1;
    const number = this.#requests;
    return { number, event: this.#send(LINK_REQUEST.encode({ number, name: utf8ToBytes(name), payload }), now_ms) };
  }

  /** Encode an empty record, as large as a command. @throws UsageError: not joined. */
  alive(now_ms: number): SessionEvent {
    this.#ready();
    return this.#send(ALIVE.encode({}), now_ms);
  }

  /** Confirm that a secret is stored, so that the previous one can be discarded. @throws UsageError: not joined. */
  stored(secret: Secret, now_ms: number): SessionEvent {
    this.#ready();
    return this.#send(STORED.encode({ id: secret.id }), now_ms);
  }

  /** End the session; the resume secret stays valid, and the robot is kept for a while. */
  leave(now_ms: number): SessionEvent[] {
    const said = this.#channel.isOpen ? [this.#send(LEAVE.encode({ keep: 1 }), now_ms)] : [];
    return [...said, ...this.#end(undefined)];
  }

  #accept(raw: Uint8Array, now_ms: number): SessionEvent[] {
    const { generation, noise } = ACCEPT.decode(raw);
    const handshake = this.#handshake;
    if (handshake === undefined) throw new Unexpected("an answer to no handshake");
    const { keys } = handshake.initiator.read(noise);
    this.#channel.adopt(generation, keys, now_ms);
    this.#handshake = undefined;
    this.#adopted_ms = now_ms;
    const resumes = handshake.secret.kind === "resume";
    const first = resumes ? READY.encode({}) : JOIN.encode({ name: utf8ToBytes(this.#name) });
    return [...this.#hear(), this.#send(first, now_ms)];
  }

  #record(raw: Uint8Array, now_ms: number): SessionEvent[] {
    if (!this.#channel.isOpen) throw new Unexpected("a record before the handshake");
    const { content, inOrder } = this.#channel.open(raw, now_ms);
    this.#heard_ms = now_ms;
    const message = decodeMessage(content);
    // Delayed on the way, these would undo later messages.
    const settles = message.kind === "secret" || message.kind === "standing";
    if (settles && !inOrder) throw new Unexpected("a record that comes after later ones");
    return this.#read(message);
  }

  #read(message: ServerMessage): SessionEvent[] {
    switch (message.kind) {
      case "welcome":
        return this.#welcome(message.visitor, message.signer, message.name);
      case "secret": {
        this.#secret = message.secret;
        const keep: SessionEvent = { ...message, kind: "keep" };
        if (this.#joined) return [keep];
        this.#earlySecret = [keep];
        return [];
      }
      case "epoch":
        if (this.#reader === undefined) {
          this.#early = [...this.#early, message.epoch].slice(-EPOCHS_KEPT);
          return [];
        }
        this.#reader.learn(message.epoch);
        return this.#hear();
      case "standing":
        this.#isWaiting = message.standing.waiting;
        return [{ ...message, kind: "stands" }];
      case "reply":
        return [{ ...message, kind: "replied" }];
      case "refused":
        return [message];
      case "end":
        return this.#end(message.reason);
    }
  }

  #welcome(visitor: number, signer: Uint8Array, name: string): SessionEvent[] {
    const key = encodeBase64url(signer);
    if (this.#reader === undefined || key !== this.#signer) {
      this.#reader = new UpdateReader(signer);
      this.#signer = key;
    }
    for (const epoch of this.#early) this.#reader.learn(epoch);
    this.#early = [];
    this.#adopted_ms = undefined;
    this.#joined = true;
    const keep = this.#earlySecret;
    this.#earlySecret = [];
    return [...this.#hear(), { kind: "admitted", visitor, name }, ...keep];
  }

  #update(raw: Uint8Array, now_ms: number): SessionEvent[] {
    if (this.#reader === undefined) throw new Unexpected("an update before admission");
    const state = this.#reader.open(raw);
    this.#heard_ms = now_ms;
    return [{ kind: "updated", state }];
  }

  #ready(): UpdateReader {
    if (this.#reader === undefined || !this.isJoined) throw new UsageError("not joined");
    return this.#reader;
  }

  #send(content: Uint8Array, now_ms: number): SessionEvent {
    this.#said_ms = now_ms;
    const topic = this.#onBroker ? recordTopic(this.#channel.sendCipher()) : "";
    return { kind: "transmit", data: this.#channel.seal(content), topic };
  }

  #hear(): SessionEvent[] {
    if (!this.#onBroker) return [];
    const topics = [
      ...this.#channel.receiveCiphers().map(recordTopic),
      ...(this.#reader?.topics() ?? []).map(encodeBase64url),
      ...(this.#handshake ? [this.#handshake.acceptTopic] : []),
    ];
    return [{ kind: "hear", topics }];
  }

  #end(reason: EndReason | undefined): SessionEvent[] {
    this.#over = true;
    this.#handshake = undefined;
    return [{ kind: "ended", reason }];
  }
}
