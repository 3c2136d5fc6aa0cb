// What frames said lately that no later frame says again. A long list is on its way for a while, and frames overtake it: what
// they said is done to it once more. In order and up to the newest, so that what was older than the list does no harm.

import { isObject, type Json, type JsonObject } from "./core/json";
import { NOTIFY_FRAME } from "./frame";

export interface Said {
  /** Some lists of a frame. */
  readonly words: JsonObject;
  readonly at_ms: number;
}

const LASTING = ["joined", "changed", "routes", "shields", "walks", "audits", "drivers", "left"] as const;
/** A list that takes longer is asked for again long before. */
const KEPT_MS = 30_000;
/** As text, which takes no more room than it is long: a thousand robots' busiest half a minute, or a peer's nonsense. */
const MOST_CHARS = 2_000_000;

export class Lately {
  #said: { readonly text: string; readonly at_ms: number }[] = [];
  #chars = 0;
  #cut = false;

  /** A notification came. */
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

  /** Something was missed: what was said before must not be done to a list that knows more. */
  forget(): void {
    this.#said = [];
    this.#chars = 0;
    this.#cut = false;
  }

  /** Oldest first; `cut` if it was too much to keep since the last time. */
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
