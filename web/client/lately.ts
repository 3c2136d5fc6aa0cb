// Recent updates that no later update repeats. A long list can be overtaken by updates on its way: they are applied to it
// again, in order and up to the newest, so outdated parts of the list do no harm.

import { isObject, type Json, type JsonObject } from "./core/json";
import { NOTIFY_FRAME } from "./frame";

export interface Said {
  /** Some lists of an update. */
  readonly words: JsonObject;
  readonly at_ms: number;
}

const LASTING = ["joined", "changed", "routes", "shields", "walks", "audits", "drivers", "left"] as const;
/** A list that takes longer is requested again earlier. */
const KEPT_MS = 30_000;
/** As text, whose size is known: half a minute of a thousand robots, or a peer's garbage. */
const MOST_CHARS = 2_000_000;

export class Lately {
  #said: { readonly text: string; readonly at_ms: number }[] = [];
  #chars = 0;
  #cut = false;

  /** A notification arrived. */
  heard(payload: Json, at_ms: number): void {
    const text = lastingText(payload);
    if (text !== undefined) {
      this.#said.push({ text, at_ms });
      this.#chars += text.length;
    }
    for (;;) {
      const [oldest] = this.#said;
      if (!oldest) return;
      const tooMuch = this.#chars > MOST_CHARS;
      if (!tooMuch && at_ms - oldest.at_ms <= KEPT_MS) return;
      this.#cut ||= tooMuch;
      this.#chars -= oldest.text.length;
      this.#said.shift();
    }
  }

  /** Updates were missed: earlier ones must not be applied to a newer list. */
  forget(): void {
    this.#said = [];
    this.#chars = 0;
    this.#cut = false;
  }

  /** Oldest first; `cut` if some were dropped since the last call. */
  tell(): { readonly said: readonly Said[]; readonly cut: boolean } {
    const cut = this.#cut;
    this.#cut = false;
    return { said: this.#said.map(({ text, at_ms }) => ({ words: JSON.parse(text) as JsonObject, at_ms })), cut };
  }
}

function lastingText(payload: Json): string | undefined {
  if (!isObject(payload) || payload["cmd"] !== NOTIFY_FRAME) return undefined;
  const { data } = payload;
  if (!isObject(data)) return undefined;
  const lasting = LASTING.filter((key) => Array.isArray(data[key]) && (data[key] as readonly Json[]).length > 0);
  return lasting.length > 0 ? JSON.stringify(Object.fromEntries(lasting.map((key) => [key, data[key]]))) : undefined;
}
