// Requests that wait for their answers, or for their slot before.

import type { Json } from "../core/json";
import { Unanswered } from "./transport";

interface Waiting {
  /** One of those that say what the swarm is; undefined: another. */
  readonly request: number | undefined;
  readonly resolve: (data: Json) => void;
  readonly reject: (error: Error) => void;
  readonly timer: ReturnType<typeof setTimeout>;
}

export class Requests {
  readonly #waiting = new Map<number, Waiting>();

  /**
   * The data of the answer. `send` sends the request, at once or later, and calls `sent` with its number first; it returns
   * false if too much waits to be sent. @throws Unanswered (the promise)
   */
  open(request: number | undefined, timeout_ms: number, send: (sent: (number: number) => void) => boolean): Promise<Json> {
    return new Promise((resolve, reject) => {
      let number: number | undefined;
      const timer = setTimeout(() => {
        if (number !== undefined) this.#waiting.delete(number);
        reject(new Unanswered(`no answer within ${timeout_ms} ms`));
      }, timeout_ms);
      const isSent = send((its) => {
        number = its;
        this.#waiting.set(its, { request, resolve, reject, timer });
      });
      if (isSent) return;
      clearTimeout(timer);
      reject(new Unanswered("too much waits to be sent"));
    });
  }

  /** Take out the request that is answered now. */
  settle(number: number): Waiting | undefined {
    const waiting = this.#waiting.get(number);
    this.#waiting.delete(number);
    clearTimeout(waiting?.timer);
    return waiting;
  }

  /** The connection was lost: nothing answers what was asked. */
  lose(): void {
    for (const number of [...this.#waiting.keys()]) this.settle(number)?.reject(new Unanswered("the connection was lost"));
  }
}
