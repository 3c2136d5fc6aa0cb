// The client's side of the protocol: which epoch is current, which topics are read, what a received message means.
//
// Pure: bytes and a time in, events and bytes out; sockets, clocks and random bytes belong to io. Whatever a peer sends,
// receive() returns: what is refused is counted by its reason and changes nothing.

import { CLIENT_MAX_BYTES, open, SERVER_MAX_BYTES, seal, TOLERANCE_S } from "./envelope";
import { BadPayload, OpenError, PeerError, UsageError, WrongTopic } from "./errors";
import { isObject, type Json, type JsonObject } from "./json";
import { deriveEpoch, type Epoch } from "./keys";
import { PART_MAX_BYTES, PartsInbox } from "./parts";
import type { Pin } from "./pin";
import { ReplayCache } from "./replay";
import { belowEpoch, fullTopic, isClientId, type SubTopic, splitTopic } from "./topics";

// 30 messages a second, twice over what a gateway sends, for the 60 s that an entry may live.
// 512 for each second in which a message may be dated: what the lists of a thousand robots take, and a flood does not fill
// without saying far more than a phone reads.
const REPLAY_CAPACITY = 60 * 512;

/** A notification for everybody. */
export interface Notified {
  readonly kind: "notified";
  readonly timestamp_s: number;
  readonly payload: Json;
}

/** The answer to a request. */
export interface Replied {
  readonly kind: "replied";
  readonly timestamp_s: number;
  readonly request: number;
  readonly data: Json;
}

/** A part of an answer; `Replied` comes with the last one. */
export interface RepliedPart {
  readonly kind: "part";
  readonly request: number;
}

/** The pin has rotated, and the link speaks under the new one. */
export interface Moved {
  readonly kind: "moved";
  readonly subscribe: readonly string[];
  readonly unsubscribe: readonly string[];
}

/** Refused, and without effect. */
export interface Rejected {
  readonly kind: "rejected";
  readonly reason: string;
  /** Only when stale: the message was authentic, and its sender's clock is this far ahead of ours. */
  readonly skew_s?: number;
}

export type LinkEvent = Notified | Replied | RepliedPart | Moved | Rejected;

/** What to hand to the broker. */
export interface Outgoing {
  readonly topic: string;
  readonly bytes: Uint8Array;
}

/** The notification of a gateway that is numbered. */
const FRAME = 16;

function frameNumber(payload: Json): number | undefined {
  if (!isObject(payload) || payload["cmd"] !== FRAME || !isObject(payload["data"])) return undefined;
  const number = payload["data"]["seq"];
  return Number.isSafeInteger(number) && (number as number) >= 0 ? (number as number) : undefined;
}

export class Link {
  readonly root: string;
  readonly clientId: string;
  /** How many messages were refused, by reason. */
  readonly rejected = new Map<string, number>();
  readonly #cache = new ReplayCache(REPLAY_CAPACITY, TOLERANCE_S);
  readonly #inbox = new PartsInbox();
  #epoch: Epoch;
  #seen: number | undefined;
  /** The last epoch in which something was heard, if nothing was in this one. */
  #left: Epoch | undefined;

  /** @throws UsageError: the client id cannot be part of a topic. */
  constructor(root: string, pin: Pin, clientId: string) {
    if (!isClientId(clientId)) throw new UsageError("the client id has characters that a topic cannot hold");
    this.root = root;
    this.clientId = clientId;
    this.#epoch = deriveEpoch(pin);
  }

  /** The newest pin: to be kept, so that a reload goes on. */
  get pin(): Pin {
    return this.#epoch.pin;
  }

  /** What to subscribe to, now and after every reconnection. */
  get subscriptions(): readonly string[] {
    return [this.#topic({ kind: "notify" }), this.#topic({ kind: "reply", client_id: this.clientId })];
  }

  /** A command for one robot. @param iv 12 fresh random bytes. @throws UsageError: more than a server reads. */
  command(
    address: string,
    application: string,
    name: string,
    payload: unknown,
    now_s: number,
    iv: Uint8Array,
  ): Outgoing {
    return this.#seal({ kind: "command", address, application, name }, payload, now_s, iv);
  }

  /** A request, answered under this link's client id. @param iv 12 fresh random bytes. */
  request(request: number, more: JsonObject, now_s: number, iv: Uint8Array): Outgoing {
    return this.#seal({ kind: "request" }, { parts: true, ...more, request, reply: this.clientId }, now_s, iv);
  }

  /** What a message from the broker means. Never throws. */
  receive(topic: string, bytes: Uint8Array, now_s: number): LinkEvent {
    try {
      return this.#read(topic, bytes, now_s);
    } catch (error) {
      // Anything but a PeerError is our own fault; even then a visitor must not lose the page to somebody's bytes.
      const reason = error instanceof PeerError ? error.reason : "handler_failed";
      this.rejected.set(reason, (this.rejected.get(reason) ?? 0) + 1);
      const skew_s = error instanceof OpenError ? error.skew_s : undefined;
      return skew_s === undefined ? { kind: "rejected", reason } : { kind: "rejected", reason, skew_s };
    }
  }

  /**
   * Back to the last epoch, if nobody speaks in this one; for a client that asked there, and was not answered.
   *
   * Somebody may have forged the pin message that led here. If nobody did, the server tells the way again.
   */
  fallBack(asked: Pin): Moved | undefined {
    const epoch = this.#left;
    if (!epoch || asked !== this.pin) return undefined;
    this.#left = undefined;
    return this.#go(epoch);
  }

  #read(topic: string, bytes: Uint8Array, now_s: number): LinkEvent {
    const sub = splitTopic(this.root, this.#epoch.topic, topic);
    const isNotify = sub.kind === "notify";
    if (!isNotify && !(sub.kind === "reply" && sub.client_id === this.clientId)) {
      throw new WrongTopic("not for this client");
    }
    const opened = open(bytes, this.#epoch, now_s, this.#cache, CLIENT_MAX_BYTES, isNotify);
    this.#left = undefined;
    if (opened.kind === "pin") return this.#move(opened.pin);
    const { payload, timestamp_s } = opened;
    if (isNotify) {
      this.#seen = frameNumber(payload) ?? this.#seen;
      return { kind: "notified", timestamp_s, payload };
    }
    if (!isObject(payload)) throw new BadPayload("an answer that is not an object");
    const { request, data } = payload;
    if (!Number.isSafeInteger(request) || data === undefined) throw new BadPayload("an answer without request or data");
    const number = request as number;
    if (payload["parts"] === undefined) return { kind: "replied", timestamp_s, request: number, data };
    if (bytes.length > PART_MAX_BYTES) throw new BadPayload("a part that should have been split");
    const whole = this.#inbox.take(number, payload);
    return whole === undefined
      ? { kind: "part", request: number }
      : { kind: "replied", timestamp_s, request: number, data: whole };
  }

  #move(pin: Pin): Moved {
    // Only a visitor who forges it announces the pin that we are on. Resubscribing for it would be work for nothing.
    if (pin.equals(this.#epoch.pin)) throw new BadPayload("a move to the current pin");
    this.#left = this.#epoch;
    return this.#go(deriveEpoch(pin));
  }

  #go(epoch: Epoch): Moved {
    const unsubscribe = this.subscriptions;
    this.#epoch = epoch;
    return { kind: "moved", subscribe: this.subscriptions, unsubscribe };
  }

  #topic(sub: SubTopic): string {
    return fullTopic(this.root, this.#epoch.topic, sub);
  }

  #seal(sub: SubTopic, payload: unknown, now_s: number, iv: Uint8Array): Outgoing {
    const topic = this.#topic(sub);
    const bound = { sub: belowEpoch(sub), seen: this.#seen };
    return { topic, bytes: seal(payload, now_s, this.#epoch, iv, SERVER_MAX_BYTES, bound) };
  }
}
