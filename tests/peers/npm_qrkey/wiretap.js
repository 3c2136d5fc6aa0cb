// Watches the hook's MQTT connection from outside. The hook does not tell when its subscriptions are acknowledged, nor
// how many messages it received but lost on the way to the page; tests need both. Nothing here alters a packet.

import mqtt from "mqtt";

export const counts = { published: 0, received: 0, connects: 0 };

// Calls onSubscribed() whenever no SUBSCRIBE is left unacknowledged.
export function watch(onSubscribed) {
  const connect = mqtt.connect;
  mqtt.connect = (...args) => {
    const client = connect(...args);
    const waiting = new Set();
    client.on("packetsend", (packet) => {
      if (packet.cmd === "subscribe") waiting.add(packet.messageId);
      if (packet.cmd === "publish") counts.published += 1;
    });
    client.on("packetreceive", (packet) => {
      if (packet.cmd === "connack") counts.connects += 1;
      if (packet.cmd === "publish") counts.received += 1;
      if (packet.cmd === "suback" && waiting.delete(packet.messageId) && waiting.size === 0) onSubscribed();
    });
    return client;
  };
}
