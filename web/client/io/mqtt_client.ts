// An MQTT client for this page: nothing is queued while disconnected.

import { bytesToHex, randomBytes } from "@noble/hashes/utils.js";
import mqtt, { type IClientOptions, type MqttClient } from "mqtt";

const KEEPALIVE_S = 60;
const CONNECT_TIMEOUT_MS = 5000;
/** CONNACK codes of MQTT 3.1.1 and MQTT 5: bad name or password, and not authorised. */
const LOGIN_REFUSED: readonly unknown[] = [4, 5, 134, 135];

export function connectTo(broker: string, version: number, more: IClientOptions): MqttClient {
  return mqtt.connect(broker, {
    // Random: a broker closes the older of two connections with the same id.
    clientId: `phalanx${bytesToHex(randomBytes(8))}`,
    protocolVersion: version === 4 ? 4 : 5,
    clean: true,
    keepalive: KEEPALIVE_S,
    connectTimeout: CONNECT_TIMEOUT_MS,
    // We resubscribe ourselves, as topics change.
    resubscribe: false,
    queueQoSZero: false,
    // By default timers run in a Worker from a blob: URL, which a strict content security policy refuses.
    timerVariant: "native",
    ...more,
  });
}

/** Whether a broker requires a login, or another one. */
export function isLoginRefused(error: Error): boolean {
  return "code" in error && LOGIN_REFUSED.includes(error.code);
}

/** Failures show as silence or a lost connection, which are handled elsewhere. */
export function ignore(): void {}
