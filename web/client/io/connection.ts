// A link over a real broker: mqtt.js carries the bytes that core/link.ts makes and reads.
//
// Nothing is queued while the broker is away: a joystick command that arrives late is worse than none.

import { bytesToHex, randomBytes } from "@noble/hashes/utils.js";
import type { MqttClient } from "mqtt";
import { UsageError } from "../core/errors";
import type { Json, JsonObject } from "../core/json";
import { IV_BYTES } from "../core/jwe";
import { Link, type Moved, type Outgoing } from "../core/link";
import type { Invitation } from "../core/qrurl";
import { REQUEST_AREA } from "../swarm";
import { NO_VISIT, type Visit } from "../visit";
import type { BrokerState } from "../watch";
import { connectTo, ignore, isLoginRefused } from "./mqtt_client";
import { type Transport, type TransportEvent, Unanswered, type Waiting } from "./transport";

const RECONNECT_MS = 1000;
const inBrowser = typeof window !== "undefined";

export class Connection implements Transport {
  readonly isPaced = false;
  readonly clientId = `phalanx_${bytesToHex(randomBytes(8))}`;
  readonly #link: Link;
  readonly #mqtt: MqttClient;
  readonly #listeners = new Set<(event: TransportEvent) => void>();
  readonly #waiting = new Set<Waiting>();
  #state: BrokerState = "connecting";
  #refused = false;
  #socket: WebSocket | undefined;

  /** Connects at once, and again whenever the broker is lost, until close(). */
  constructor(to: Invitation) {
    this.#link = new Link(to.root, to.pin, this.clientId);
    // Its name there is not the client id that answers are addressed to: that one is in a topic.
    this.#mqtt = connectTo(to.broker, to.mqtt, {
      ...to.login,
      reconnectPeriod: RECONNECT_MS,
      // A broker that is full, or learns a new password, may take us later.
      reconnectOnConnackError: true,
      ...(inBrowser && {
        createWebsocket: (url: string, protocols: string[]) => (this.#socket = new WebSocket(url, protocols)),
      }),
    });
    this.#mqtt.on("connect", () => {
      // Online means that what is said from now on is heard.
      this.#mqtt.subscribe([...this.#link.subscriptions], { qos: 0 }, (denied) => {
        if (denied) this.restart();
        else if (this.#mqtt.connected) this.#setState("online");
      });
    });
    this.#mqtt.on("reconnect", () => {
      this.#refused = false;
    });
    this.#mqtt.on("close", () => this.#setState(this.#refused ? "refused" : "offline"));
    // mqtt.js goes on trying by itself; without a listener the event would be thrown.
    this.#mqtt.on("error", (error) => {
      this.#refused = isLoginRefused(error);
      if (!this.#mqtt.connected) this.#setState(this.#refused ? "refused" : "offline");
    });
    this.#mqtt.on("message", (topic, bytes) => this.#receive(topic, bytes));
  }

  get name(): string {
    return this.clientId.slice(-6);
  }

  get visit(): Visit {
    return NO_VISIT;
  }

  get state(): BrokerState {
    return this.#state;
  }

  /** The pin now in use, which rotations replace. */
  get pin(): Link["pin"] {
    return this.#link.pin;
  }

  /** How many messages were refused, by reason. */
  get rejected(): ReadonlyMap<string, number> {
    return this.#link.rejected;
  }

  /** Be told of everything that happens; the result ends it. */
  listen(listener: (event: TransportEvent) => void): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Send a command, unless the broker is away: then false, and nothing is kept for later. */
  command(address: string, application: string, name: string, payload: unknown): boolean {
    return this.#publish(this.#link.command(address, application, name, payload, now_s(), randomBytes(IV_BYTES)));
  }

  /** The data of the answer. @param more further keys of the request. @throws Unanswered (the promise) */
  request(request: number, more: JsonObject = {}, timeout_ms = 3000): Promise<Json> {
    if (!Number.isSafeInteger(request)) throw new UsageError("a request is a whole number");
    return new Promise((resolve, reject) => {
      const asked = this.pin;
      if (!this.#publish(this.#link.request(request, more, now_s(), randomBytes(IV_BYTES)))) {
        reject(new Unanswered("the broker is away"));
        return;
      }
      const waiting: Waiting = {
        request,
        resolve,
        reject,
        timer: setTimeout(() => {
          this.#waiting.delete(waiting);
          reject(new Unanswered(`no answer within ${timeout_ms} ms`));
          const back = this.#link.fallBack(asked);
          if (back) this.#follow(back);
        }, timeout_ms),
      };
      this.#waiting.add(waiting);
    });
  }

  wake(): void {
    // mqtt.js goes on trying by itself.
  }

  hide(): void {
    // Nothing waits.
  }

  /** Say that nobody is here any more; whoever asks something again has come back. */
  leave(): void {
    if (!this.#mqtt.connected) return;
    const more = { frames: true, leaving: true };
    const { topic, bytes } = this.#link.request(REQUEST_AREA, more, now_s(), randomBytes(IV_BYTES));
    // What mqtt.js sends a moment later would never leave.
    this.#socket?.send(publishPacket(topic, bytes, this.#mqtt.options.protocolVersion === 5));
  }

  /** Give up a connection that may be dead or was denied its topics, and make another. */
  restart(): void {
    if (this.#mqtt.connected) this.#mqtt.stream.destroy();
  }

  /** Disconnect for good. */
  close(): void {
    this.#listeners.clear();
    for (const waiting of this.#waiting) {
      clearTimeout(waiting.timer);
      waiting.reject(new Unanswered("closed"));
    }
    this.#waiting.clear();
    this.#mqtt.end(true);
  }

  #publish({ topic, bytes }: Outgoing): boolean {
    if (!this.#mqtt.connected) return false;
    this.#mqtt.publish(topic, bytes as Buffer, { qos: 0, retain: false }, ignore);
    return true;
  }

  #receive(topic: string, bytes: Uint8Array): void {
    const event = this.#link.receive(topic, bytes, now_s());
    if (event.kind === "moved") {
      this.#follow(event);
      return;
    }
    if (event.kind === "replied") {
      for (const waiting of this.#waiting) {
        if (waiting.request !== event.request) continue;
        this.#waiting.delete(waiting);
        clearTimeout(waiting.timer);
        waiting.resolve(event.data);
      }
    }
    this.#emit(event);
  }

  #follow(moved: Moved): void {
    this.#mqtt.unsubscribe([...moved.unsubscribe], ignore);
    this.#mqtt.subscribe([...moved.subscribe], { qos: 0 }, (denied) => {
      if (denied) this.restart();
      this.#emit(moved);
    });
  }

  #setState(state: BrokerState): void {
    if (state === this.#state) return;
    this.#state = state;
    this.#emit({ kind: "broker", state });
  }

  #emit(event: TransportEvent): void {
    for (const listener of this.#listeners) listener(event);
  }
}

/** An MQTT PUBLISH with QoS 0. */
function publishPacket(topic: string, bytes: Uint8Array, hasProperties: boolean): Uint8Array<ArrayBuffer> {
  const name = new TextEncoder().encode(topic);
  const body = [name.length >> 8, name.length & 255, ...name, ...(hasProperties ? [0] : []), ...bytes];
  const length: number[] = [];
  for (let rest = body.length; rest > 0 || length.length === 0; rest >>= 7) length.push((rest & 127) | (rest > 127 ? 128 : 0));
  return new Uint8Array([0x30, ...length, ...body]);
}

function now_s(): number {
  return Date.now() / 1000;
}
