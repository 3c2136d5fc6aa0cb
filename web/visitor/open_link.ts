// Opens the transport that an invitation needs. The MQTT client is larger than all the rest: who needs none loads none.

import { type Invitation, type Pin, ResumeStore, browserStores, SessionConnection, type SessionTo, type Transport } from "../client";

/** Resume secrets of this origin. */
export const resumeStore = new ResumeStore(browserStores());

export async function openQrkey(to: Invitation, onMoved: (pin: Pin) => void): Promise<Transport> {
  const { Connection } = await import("../client/io/connection");
  const connection = new Connection(to);
  connection.listen(({ kind }) => {
    if (kind === "moved") onMoved(connection.pin);
  });
  return connection;
}

export async function openSession(to: SessionTo): Promise<SessionConnection> {
  if (to.at.broker === "") return new SessionConnection(to, resumeStore);
  const { BrokerWay } = await import("../client/io/broker_way");
  return new SessionConnection(to, resumeStore, () => new BrokerWay(to.at));
}
