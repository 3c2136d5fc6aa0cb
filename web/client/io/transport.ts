// Transport between a swarm and its visitors: a session, over a websocket or a broker.

import type { Json } from "../core/json";
import type { Reason } from "../session";
import type { Visit } from "../visit";
import type { BrokerState } from "../watch";

export type TransportEvent =
  /** A state update for all visitors. */
  | { readonly kind: "notified"; readonly payload: Json }
  | { readonly kind: "replied"; readonly request: number; readonly data: Json }
  /** Refused, without effect. */
  | { readonly kind: "rejected"; readonly reason: string }
  | { readonly kind: "broker"; readonly state: BrokerState }
  | { readonly kind: "visit"; readonly visit: Visit };

export interface Transport {
  readonly state: BrokerState;
  readonly visit: Visit;
  /** Subscribe to all events; call the result to unsubscribe. */
  listen(listener: (event: TransportEvent) => void): () => void;
  /** Send a command; false if not possible now: nothing is queued. */
  command(address: string, name: string, payload: unknown): boolean;
  /** Return the data of the answer. @throws Unanswered (the promise) */
  request(request: number, timeout_ms?: number): Promise<Json>;
  /** The device woke up, or has a network again. */
  wake(): void;
  /** The page is hidden, and may be frozen: send urgent data at once. */
  hide(): void;
  /** The page is being closed. */
  leave(): void;
  /** Abandon a connection that may be dead, and open another. */
  restart(): void;
  /** Disconnect permanently. */
  close(): void;
}

/** No answer: disconnected, no answer in time, refused, or the connection was closed. */
export class Unanswered extends Error {
  override readonly name: string = "Unanswered";
}

/** The swarm refused the request. */
export class Refused extends Unanswered {
  override readonly name = "Refused";
  readonly reason: Reason;

  constructor(reason: Reason) {
    super(`refused: ${reason}`);
    this.reason = reason;
  }
}
