// What an operator does and sees, over the link. On the gateway's own machine the stop takes its own way.

import {
  type Json,
  type Reason,
  Refused,
  type SessionConnection,
  type SwarmLink,
  type SwarmSource,
  UsageError,
} from "../client";
import type { Local } from "./local";

/** A stop is asked for again until it is answered, for so long. */
const STOP_FOR_MS = 10_000;
const STOP_AGAIN_MS = 500;
const AGAIN: readonly Reason[] = ["late", "too_many"];
const WORDS: Readonly<Record<Reason, string>> = {
  late: "That came too late. Try again.",
  not_allowed: "That is not allowed: there is no such robot, or this visitor may not drive it.",
  busy: "The code has just changed; the one before it has to end first.",
  too_many: "That was asked too often. Try again.",
  bad: "The gateway does not understand this page. Reload it.",
  unknown: "The gateway knows no such visitor, robot or attack.",
  held: "All robots are stopped.",
  failed: "The gateway could not do that; its log says why.",
};

export interface Station {
  /** The swarm as it moves. */
  readonly source: SwarmSource;
  /** The answer to a request. @throws Unanswered, Refused (the promise) */
  ask(what: string, words?: object, timeout_ms?: number): Promise<Json>;
  /** Stop all robots, or let them go; why that failed, in words. */
  hold(held: boolean): Promise<string | undefined>;
}

/** Have the gateway do something; why it did not, in words. */
export async function order(station: Station, what: string, words: object = {}): Promise<string | undefined> {
  try {
    await station.ask(what, words);
    return undefined;
  } catch (error) {
    return error instanceof Refused ? WORDS[error.reason] : "The gateway does not answer.";
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

  ask(what: string, words: object = {}, timeout_ms?: number): Promise<Json> {
    return this.#link.transport.ask(what, words, timeout_ms);
  }

  async hold(held: boolean): Promise<string | undefined> {
    if (this.#local) {
      return this.#local.hold(held).then(
        () => undefined,
        () => "The gateway does not answer.",
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
        if (error instanceof Refused && !AGAIN.includes(error.reason)) return WORDS[error.reason];
        if (error instanceof UsageError) throw error;
      }
      if (!held || wanted !== this.#wanted || performance.now() > until_ms) return "The gateway does not answer.";
      await new Promise((resolve) => setTimeout(resolve, STOP_AGAIN_MS));
    }
  }
}
