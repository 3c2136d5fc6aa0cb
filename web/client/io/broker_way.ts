// A session over an untrusted broker. Loaded only if a code names one: mqtt.js is the largest part.

import type { MqttClient } from "mqtt";
import type { Where } from "../session";
import { connectTo, ignore, isLoginRefused } from "./mqtt_client";
import { REFUSED_LOGIN, type Way } from "./websocket_way";

export class BrokerWay implements Way {
  onOpen = (): void => {};
  onMessage: Way["onMessage"] = () => {};
  onClose: Way["onClose"] = () => {};
  readonly #mqtt: MqttClient;
  readonly #root: string;
  #topics: readonly string[] = [];
  #reason = "";

  /** Connects once: after a loss, the session connects again and resumes. */
  constructor({ broker, root, mqtt }: Where) {
    this.#root = root;
    this.#mqtt = connectTo(broker, mqtt, { reconnectPeriod: 0 });
    this.#mqtt.on("connect", () => this.onOpen());
    this.#mqtt.on("message", (topic, data) => {
      if (this.#topics.includes(topic)) this.onMessage(new Uint8Array(data));
    });
    this.#mqtt.on("close", () => this.onClose(this.#reason));
    // Without a listener the event would be thrown; "close" follows.
    this.#mqtt.on("error", (error) => {
      if (isLoginRefused(error)) this.#reason = REFUSED_LOGIN;
    });
  }

  get isOpen(): boolean {
    return this.#mqtt.connected;
  }

  send(data: Uint8Array, topic: string): void {
    if (!this.isOpen) return;
    this.#mqtt.publish(`${this.#root}/${topic}`, data as Buffer, { qos: 0, retain: false }, ignore);
    // Immediately, not in a timer: a page that is being closed runs none.
    this.#mqtt.stream.uncork();
  }

  hear(topics: readonly string[]): void {
    const wanted = topics.map((each) => `${this.#root}/${each}`);
    const [added, left] = [difference(wanted, this.#topics), difference(this.#topics, wanted)];
    this.#topics = wanted;
    // A broker handles a client's packets in order: these subscriptions precede the next publication.
    if (added.length > 0) this.#mqtt.subscribe(added, { qos: 0 }, (denied) => denied && this.#mqtt.stream.destroy());
    if (left.length > 0) this.#mqtt.unsubscribe(left, ignore);
  }

  close(): void {
    this.onOpen = this.onMessage = this.onClose = () => {};
    // Let the last messages be sent.
    this.#mqtt.end();
  }
}

function difference(all: readonly string[], without: readonly string[]): string[] {
  return all.filter((each) => !without.includes(each));
}
