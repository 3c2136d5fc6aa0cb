// Opens the transport that an invitation needs. The MQTT client is larger than all the rest: who needs none loads none.

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
