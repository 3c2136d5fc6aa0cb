// The envelope: a timestamp and a payload, sealed; and the one message that goes without, the pin message.

import { encodeBase64url } from "./base64url";
import { MalformedEnvelope, OpenError, PeerError, UsageError } from "./errors";
import { has, type Json, type JsonObject, parseObject } from "./json";
import { openJwe, sealJwe } from "./jwe";
import type { Epoch } from "./keys";
import { Pin } from "./pin";
import type { ReplayCache } from "./replay";

export const PIN_MESSAGE_CMD = 255;
/** Largest |now - timestamp| that passes. */
export const TOLERANCE_S = 30;
/** Longest plaintext that a client reads, and that a server reads. */
export const CLIENT_MAX_BYTES = 1024 * 1024;
export const SERVER_MAX_BYTES = 48 * 1024;

const encoder = new TextEncoder();

/** An authentic, fresh message that was not seen before; or the new pin that a pin message announces. */
export type Opened =
  | { readonly kind: "envelope"; readonly timestamp_s: number; readonly payload: Json }
  | { readonly kind: "pin"; readonly pin: Pin };

/** What a client of ours seals beside its payload; published peers neither say nor read it. */
export interface Bound {
  /** Topic below the epoch that it is sealed for. */
  readonly sub: string;
  /** Number of the last frame that was read, if one was. */
  readonly seen: number | undefined;
}

/**
 * `payload` sealed for everybody in `epoch`; `iv` is 12 fresh random bytes.
 *
 * @throws UsageError: more than `max_bytes` of plaintext, which the receiver would refuse.
 */
export function seal(
  payload: unknown,
  now_s: number,
  epoch: Epoch,
  iv: Uint8Array,
  max_bytes: number = CLIENT_MAX_BYTES,
  bound?: Bound,
): Uint8Array {
  const plaintext = encoder.encode(JSON.stringify({ timestamp: now_s, payload, ...bound }));
  if (plaintext.length > max_bytes) throw new UsageError(`${plaintext.length} bytes to send, limit ${max_bytes}`);
  return sealJwe(plaintext, epoch.key, iv);
}

/**
 * What is in `token`.
 *
 * @param cache of this receiver; entered once the message is authentic and fresh.
 * @param pinMessageMayCome true for a client reading a notification.
 * @throws OpenError, whatever went wrong.
 */
export function open(
  token: Uint8Array,
  epoch: Epoch,
  now_s: number,
  cache: ReplayCache,
  max_bytes: number,
  pinMessageMayCome: boolean,
): Opened {
  try {
    const { iv, plaintext } = openJwe(token, epoch.key, max_bytes);
    const words = parseObject(plaintext);
    if (pinMessageMayCome && !has(words, "timestamp") && words["cmd"] === PIN_MESSAGE_CMD) {
      return { kind: "pin", pin: announcedPin(words) };
    }
    const timestamp_s = words["timestamp"];
    if (typeof timestamp_s !== "number" || !Number.isFinite(timestamp_s)) throw new MalformedEnvelope("no timestamp");
    const payload = words["payload"];
    if (!has(words, "payload") || payload === undefined) throw new MalformedEnvelope("no payload");
    cache.enter(epoch.topic, encodeBase64url(iv), timestamp_s, now_s);
    return { kind: "envelope", timestamp_s, payload };
  } catch (error) {
    if (error instanceof PeerError) throw new OpenError(error);
    throw error;
  }
}

function announcedPin(words: JsonObject): Pin {
  try {
    return new Pin(words["pin_code"]);
  } catch {
    throw new MalformedEnvelope("a pin message without a pin");
  }
}
