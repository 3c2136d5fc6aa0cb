// Requests to the gateway on this machine, authorised by the token of the link that it printed: the emergency stop, which
// depends on nothing else, and the way to the link, which serves all other requests.

import { isObject, parseInvitation, type Secret } from "../client";

const ANSWER_WITHIN_MS = 4000;
/** Validity of a ticket for immediate use. */
const VALID_S = 60;

/** The gateway has another token. */
export class WrongToken extends Error {}

export interface Ways {
  /** URL of the websocket. */
  readonly link: string;
  readonly fixed: string;
}

export class Local {
  readonly #token: string;

  constructor(token: string) {
    this.#token = token;
  }

  /** Stop all robots, or release them. @throws WrongToken, Error (the promise) */
  async hold(held: boolean): Promise<void> {
    await this.#post(held ? "stop" : "go");
  }

  /** Return the link's address, and the swarm's public key. @throws as hold() */
  async where(): Promise<Ways> {
    const { link, static: fixed } = await this.#post("link/where");
    if (typeof link !== "string" || typeof fixed !== "string") throw new Error("another version");
    return { link, fixed };
  }

  /** Request a ticket for this page. @throws as hold(), BadInvitation */
  async ticket(): Promise<Secret> {
    const { url } = await this.#post("link/invite", { role: "operate", valid_s: VALID_S, name: "Operator" });
    return parseInvitation(String(url)).secret;
  }

  async #post(what: string, words: object = {}): Promise<Readonly<Record<string, unknown>>> {
    const answer = await fetch(`/api/${what}`, {
      method: "POST",
      headers: { Authorization: `Bearer ${this.#token}`, "Content-Type": "application/json" },
      body: JSON.stringify(words),
      cache: "no-store",
      credentials: "omit",
      // The token is sent to the gateway only.
      redirect: "error",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    if (answer.status === 401 || answer.status === 403) throw new WrongToken();
    const said: unknown = await answer.json();
    if (!answer.ok || !isObject(said)) throw new Error(`answered ${answer.status}`);
    return said;
  }
}
