// Requests that wait for answers, or for their slot.

import type { Json } from "../core/json";
import { Unanswered } from "./transport";

interface Waiting {
  /** Number of a request for the swarm's state; undefined for others. */
  readonly request: number | undefined;
  readonly resolve: (data: Json) => void;
  readonly reject: (error: Error) => void;
  readonly timer: ReturnType<typeof setTimeout>;
}

export class Requests {
  readonly #waiting = new Map<number, Waiting>();

  /**
   * Return the data of the answer. `send` sends the request, now or later, and calls `sent` with its number first; it returns
   * false if too many wait. @throws Unanswered (the promise)
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

  /** Remove the answered request. */
  settle(number: number): Waiting | undefined {
    const waiting = this.#waiting.get(number);
    this.#waiting.delete(number);
    clearTimeout(waiting?.timer);
    return waiting;
  }

  /** The connection was lost: open requests get no answer. */
  lose(): void {
    for (const number of [...this.#waiting.keys()]) this.settle(number)?.reject(new Unanswered("the connection was lost"));
  }
}
