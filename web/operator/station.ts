// The operator's requests and data over the link. On the gateway's own machine the stop bypasses the link.

import {
  type Json,
  type Reason,
  Refused,
  type SessionConnection,
  type SwarmLink,
  type SwarmSource,
  UsageError,
} from "../client";
import { operator as texts } from "../texts";
import type { Local } from "./local";

const ANSWER_WITHIN_MS = 3000;
/** A stop is repeated until answered, for this long. */
const STOP_FOR_MS = 10_000;
const STOP_AGAIN_MS = 500;
const AGAIN: readonly Reason[] = ["late", "too_many"];

export interface Station {
  /** The live swarm. */
  readonly source: SwarmSource;
  /** Return the answer to a request. @throws Unanswered, Refused (the promise) */
  ask(what: string, words?: object, timeout_ms?: number): Promise<Json>;
  /** Stop all robots, or release them; return an error message if that failed. */
  hold(held: boolean): Promise<string | undefined>;
}

/** Send an order to the gateway; return an error message if it failed. */
export async function order(station: Station, what: string, words: object = {}): Promise<string | undefined> {
  try {
    await station.ask(what, words);
    return undefined;
  } catch (error) {
    return error instanceof Refused ? texts.refused[error.reason] : texts.doesNotAnswer;
  }
}

export class LinkStation implements Station {
  readonly #link: SwarmLink<SessionConnection>;
  readonly #local: Local | undefined;
  #wanted = 0;

  constructor(link: SwarmLink<SessionConnection>, local: Local | undefined) {
    this.#link = link;
    this.#local = local;
  }

  get source(): SwarmSource {
    return this.#link;
  }

  async ask(what: string, words: object = {}, timeout_ms = ANSWER_WITHIN_MS): Promise<Json> {
    await this.#joined(timeout_ms);
    return this.#link.transport.ask(what, words, timeout_ms);
  }

  /** Resolve when the session has begun, or after that time: a click may come before it. */
  async #joined(timeout_ms: number): Promise<void> {
    const { transport } = this.#link;
    if (transport.visit.stage === "here") return;
    await new Promise<void>((resolve) => {
      const look = () => {
        if (transport.visit.stage === "here") done();
      };
      const unlisten = transport.listen(look);
      const timer = setTimeout(() => done(), timeout_ms);
      function done() {
        unlisten();
        clearTimeout(timer);
        resolve();
      }
    });
  }

  async hold(held: boolean): Promise<string | undefined> {
    if (this.#local) {
      return this.#local.hold(held).then(
        () => undefined,
        () => texts.doesNotAnswer,
      );
    }
    this.#wanted += 1;
    const wanted = this.#wanted;
    const until_ms = performance.now() + STOP_FOR_MS;
    for (;;) {
      try {
        await this.ask(held ? "stop" : "go", {}, 2 * STOP_AGAIN_MS);
        return undefined;
      } catch (error) {
        if (error instanceof Refused && !AGAIN.includes(error.reason)) return texts.refused[error.reason];
        if (error instanceof UsageError) throw error;
      }
      if (!held || wanted !== this.#wanted || performance.now() > until_ms) return texts.doesNotAnswer;
      await new Promise((resolve) => setTimeout(resolve, STOP_AGAIN_MS));
    }
  }
}
