// An MQTT client as this page wants it: nothing is queued while the broker is away.

import { bytesToHex, randomBytes } from "@noble/hashes/utils.js";
import mqtt, { type IClientOptions, type MqttClient } from "mqtt";

const KEEPALIVE_S = 60;
const CONNECT_TIMEOUT_MS = 5000;
/** Reasons of a CONNACK, of MQTT 3.1.1 and of MQTT 5: a bad name or password, and not allowed. */
const LOGIN_REFUSED: readonly unknown[] = [4, 5, 134, 135];

export function connectTo(broker: string, version: number, more: IClientOptions): MqttClient {
  return mqtt.connect(broker, {
    // Known to nobody: a broker closes the older of two connections of one name.
    clientId: `phalanx${bytesToHex(randomBytes(8))}`,
    protocolVersion: version === 4 ? 4 : 5,
    clean: true,
    keepalive: KEEPALIVE_S,
    connectTimeout: CONNECT_TIMEOUT_MS,
    // Ours: topics to resubscribe to may be others than those first asked for.
    resubscribe: false,
    queueQoSZero: false,
    // The default runs its timers in a Worker made from a blob: URL, which a strict content security policy refuses.
    timerVariant: "native",
    ...more,
  });
}

/** Whether a broker wants a login, or another one. */
export function isLoginRefused(error: Error): boolean {
  return "code" in error && LOGIN_REFUSED.includes(error.code);
}

/** A failure shows as silence or as a lost connection, and both are seen elsewhere. */
export function ignore(): void {}
