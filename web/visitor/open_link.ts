// Open the transport for an invitation. The MQTT client, the largest part, is loaded only if needed.

import { ResumeStore, browserStores, SessionConnection, type SessionTo } from "../client";

/** Resume secrets of this origin. */
export const resumeStore = new ResumeStore(browserStores());

export async function openSession(to: SessionTo): Promise<SessionConnection> {
  if (to.at.broker === "") return new SessionConnection(to, resumeStore);
  const { BrokerWay } = await import("../client/io/broker_way");
  return new SessionConnection(to, resumeStore, () => new BrokerWay(to.at));
}
