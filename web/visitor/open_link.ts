// Open the transport for an invitation. The MQTT client, the largest part, is loaded only if needed.

import { SessionConnection, type SessionTo, WebsocketWay } from "../client";
import { resumeStore } from "./resumes";

/** `first` is a websocket to begin with: an open one, or one that is being opened. */
export async function openSession(to: SessionTo, first: WebsocketWay | undefined): Promise<SessionConnection> {
  if (to.at.broker === "") {
    let unused = first;
    return new SessionConnection(to, resumeStore, () => {
      const way = unused?.isOver === false ? unused : new WebsocketWay(to.url);
      unused = undefined;
      return way;
    });
  }
  const { BrokerWay } = await import("../client/io/broker_way");
  return new SessionConnection(to, resumeStore, () => new BrokerWay(to.at));
}
