// The live swarm for the projector: updates over HTTP, as that page is not a client of the link.

import { useEffect, useState } from "react";
import { type Json, NO_SWARM, NO_VISIT, type SwarmSource, type SwarmView, swarmReducer } from "../client";
import { isObject } from "../client/core/json";

const PATH = "/api/projector/frames";
const AGAIN_MS = 500;
/** The longest line: a list of two thousand robots. */
const MOST_CHARS = 16_000_000;

export class Live implements SwarmSource {
  readonly #token: string;
  readonly #listeners = new Set<() => void>();
  readonly #ended = new AbortController();
  #view: SwarmView = { swarm: NO_SWARM, health: { state: "connecting", broker: "away" }, visit: NO_VISIT };

  constructor(token: string) {
    this.#token = token;
    void this.#run();
  }

  get view(): SwarmView {
    return this.#view;
  }

  subscribe(listener: () => void): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  close(): void {
    this.#listeners.clear();
    this.#ended.abort();
  }

  async #run(): Promise<void> {
    while (!this.#ended.signal.aborted) {
      try {
        await this.#read();
      } catch {
        // The gateway is away, which the poll once a second shows.
      }
      // The gateway ends the stream now and then; the page reconnects silently.
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }

  async #read(): Promise<void> {
    const answer = await fetch(PATH, {
      headers: { Authorization: `Bearer ${this.#token}` },
      cache: "no-store",
      credentials: "omit",
      redirect: "error",
      signal: this.#ended.signal,
    });
    if (!answer.ok || !answer.body) return;
    this.#show(swarmReducer(this.#view.swarm, { kind: "reconnected" }));
    const reader = answer.body.getReader();
    const decoder = new TextDecoder();
    let rest = "";
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      const lines = (rest + decoder.decode(value, { stream: true })).split("\n");
      rest = lines.pop() ?? "";
      if (rest.length > MOST_CHARS) return;
      for (const line of lines) this.#take(JSON.parse(line) as Json);
    }
  }

  #take(words: Json): void {
    if (!isObject(words)) return;
    const at_ms = performance.now();
    const { swarm } = this.#view;
    const { request, data } = words;
    if (typeof request === "number" && data !== undefined) {
      this.#show(swarmReducer(swarm, { kind: "replied", request, data, at_ms }));
    } else this.#show(swarmReducer(swarm, { kind: "notified", payload: words, at_ms }));
  }

  #show(swarm: SwarmView["swarm"]): void {
    this.#view = { swarm, health: { state: "live" }, visit: NO_VISIT };
    for (const listener of this.#listeners) listener();
  }
}

/** The live swarm, while the component is mounted. */
export function useLive(token: string): Live | undefined {
  const [live, setLive] = useState<Live>();
  useEffect(() => {
    const opened = new Live(token);
    setLive(opened);
    return () => {
      opened.close();
      setLive(undefined);
    };
  }, [token]);
  return live;
}
