// Stores the secrets to resume with, by the swarm's public key.
//
// On https as long as the server allows, in all tabs of this origin. On plain http for an hour and in this tab only:
// in another network, another machine may have the same address, and its page could read the secret.

import { decodeBase64url, encodeBase64url } from "../core/base64url";
import { checkWhere, Secret, type Where } from "../session";

/** Key prefix of visitors; operators on the same origin have another. */
const PREFIX = "phalanx.session.";
const HTTP_MAX_S = 3600;
const SECRET_BYTES = 32;
/** Tolerance for a clock that was set back. */
const CLOCK_S = 60;

export interface Kept {
  readonly fixed: Uint8Array;
  readonly at: Where;
  readonly secret: Secret;
  readonly name: string;
  /** The tab that stored it. */
  readonly tab: string;
}

/** The browser's objects in use: passed in for tests. */
export interface Stores {
  readonly isSecure: boolean;
  readonly local: Storage | undefined;
  readonly tab: Storage | undefined;
}

export class ResumeStore {
  readonly #storage: Storage | undefined;
  readonly #max_s: number;
  readonly #prefix: string;

  constructor({ isSecure, local, tab }: Stores, prefix = PREFIX) {
    this.#prefix = prefix;
    this.#storage = isSecure ? local : tab;
    this.#max_s = isSecure ? Number.POSITIVE_INFINITY : HTTP_MAX_S;
  }

  keep({ fixed, at: { broker, root, mqtt }, secret, name, tab }: Kept, lifetime_s: number, now_s: number): void {
    const words = {
      secret: encodeBase64url(secret.reveal()),
      at: { broker, root, mqtt },
      name,
      tab,
      kept_s: now_s,
      until_s: now_s + Math.min(lifetime_s, this.#max_s),
    };
    try {
      this.#storage?.setItem(this.#prefix + encodeBase64url(fixed), JSON.stringify(words));
    } catch {
      // Full or forbidden: after a reload the visitor has to scan again.
    }
  }

  /** The secret for this swarm, unless expired. */
  find(fixed: Uint8Array, now_s: number): Kept | undefined {
    return this.#read(this.#prefix + encodeBase64url(fixed), now_s)?.kept;
  }

  /** The secret of the swarm visited last on this origin. */
  newest(now_s: number): Kept | undefined {
    const all = this.#keys().flatMap((key) => this.#read(key, now_s) ?? []);
    return all.sort((a, b) => b.kept_s - a.kept_s)[0]?.kept;
  }

  forget(fixed: Uint8Array): void {
    this.#remove(this.#prefix + encodeBase64url(fixed));
  }

  #read(key: string, now_s: number): { readonly kept: Kept; readonly kept_s: number } | undefined {
    try {
      const text = this.#storage?.getItem(key);
      if (text === undefined || text === null) return undefined;
      const words = JSON.parse(text) as Readonly<Record<string, unknown>>;
      const { kept_s, until_s, name, tab } = words;
      const secret = bytesOf(words["secret"]);
      const fixed = bytesOf(key.slice(this.#prefix.length));
      const at = words["at"] as Where;
      checkWhere(at);
      const isTime = typeof kept_s === "number" && typeof until_s === "number";
      // A clock that was set back must not extend its validity.
      const isValid = isTime && kept_s <= now_s + CLOCK_S && now_s < until_s;
      if (isValid && secret?.length === SECRET_BYTES && fixed?.length === SECRET_BYTES)
        return { kept: { fixed, at, secret: new Secret("resume", secret), name: String(name), tab: String(tab) }, kept_s };
    } catch {
      // Malformed: removed below.
    }
    this.#remove(key);
    return undefined;
  }

  #keys(): string[] {
    try {
      const { length } = this.#storage ?? { length: 0 };
      const all = Array.from({ length }, (_, i) => this.#storage?.key(i) ?? "");
      return all.filter((key) => key.startsWith(this.#prefix));
    } catch {
      return [];
    }
  }

  #remove(key: string): void {
    try {
      this.#storage?.removeItem(key);
    } catch {
      // Forbidden: nothing was stored either.
    }
  }
}

function bytesOf(text: unknown): Uint8Array | undefined {
  return typeof text === "string" ? decodeBase64url(new TextEncoder().encode(text)) : undefined;
}

/** The storage of this page. */
export function browserStores(): Stores {
  return { isSecure: location.protocol === "https:", local: storageOf("localStorage"), tab: storageOf("sessionStorage") };
}

function storageOf(which: "localStorage" | "sessionStorage"): Storage | undefined {
  try {
    return window[which];
  } catch {
    // Reading the property throws if site data is forbidden.
    return undefined;
  }
}
