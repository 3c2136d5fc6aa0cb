// What carries a swarm's words to its visitors and back: a session on a websocket, or a broker with a shared key.

import type { Json, JsonObject } from "../core/json";
import type { LinkEvent } from "../core/link";
import type { Reason } from "../session";
import type { Visit } from "../visit";
import type { BrokerState } from "../watch";

export type TransportEvent =
  | LinkEvent
  | { readonly kind: "broker"; readonly state: BrokerState }
  | { readonly kind: "visit"; readonly visit: Visit };

export interface Transport {
  /** What the gateway calls us when we drive. */
  readonly name: string;
  readonly state: BrokerState;
  /** Of a session. */
  readonly visit: Visit;
  /** Commands wait for the slots of a constant rate, so that each change may be said as soon as it is there. */
  readonly isPaced: boolean;
  /** Be told of everything that happens; the result ends it. */
  listen(listener: (event: TransportEvent) => void): () => void;
  /** Send a command, or false: then nothing is kept for later. */
  command(address: string, application: string, name: string, payload: unknown): boolean;
  /** The data of the answer. @throws Unanswered (the promise) */
  request(request: number, more?: JsonObject, timeout_ms?: number): Promise<Json>;
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

/** A request that waits for its answer. */
export interface Waiting {
  /** One of those that say what the swarm is; undefined: another. */
  readonly request: number | undefined;
  readonly resolve: (data: Json) => void;
  readonly reject: (error: Error) => void;
  readonly timer: ReturnType<typeof setTimeout>;
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
