// What carries a swarm's words to its visitors and back: a session, on a websocket or a broker.

import type { Json } from "../core/json";
import type { Reason } from "../session";
import type { Visit } from "../visit";
import type { BrokerState } from "../watch";

export type TransportEvent =
  /** A state update, for everybody. */
  | { readonly kind: "notified"; readonly payload: Json }
  | { readonly kind: "replied"; readonly request: number; readonly data: Json }
  /** Refused, and without effect. */
  | { readonly kind: "rejected"; readonly reason: string }
  | { readonly kind: "broker"; readonly state: BrokerState }
  | { readonly kind: "visit"; readonly visit: Visit };

export interface Transport {
  readonly state: BrokerState;
  readonly visit: Visit;
  /** Be told of everything that happens; the result ends it. */
  listen(listener: (event: TransportEvent) => void): () => void;
  /** Send a command, or false: then nothing is kept for later. */
  command(address: string, name: string, payload: unknown): boolean;
  /** The data of the answer. @throws Unanswered (the promise) */
  request(request: number, timeout_ms?: number): Promise<Json>;
  /** The device woke up, or has a network again. */
  wake(): void;
  /** The page is not seen any more, and may be frozen: say at once what must not wait. */
  hide(): void;
  /** The page is being closed. */
  leave(): void;
  /** Give up a connection that may be dead, and make another. */
  restart(): void;
  /** Disconnect for good. */
  close(): void;
}

/** No answer: there is no connection, the swarm did not answer in time or refused, or the connection was closed. */
export class Unanswered extends Error {
  override readonly name: string = "Unanswered";
}

/** The swarm answered that it will not. */
export class Refused extends Unanswered {
  override readonly name = "Refused";
  readonly reason: Reason;

  constructor(reason: Reason) {
    super(`refused: ${reason}`);
    this.reason = reason;
  }
}
