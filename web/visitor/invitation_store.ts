// Where the page finds its invitation, and how it keeps its secret out of sight.
//
// From the address (and removed from it at once, so that it stays in no history, screenshot or shared link), else from
// this tab's session storage, where a code is kept until it has admitted us.

import { BadInvitation, parseInvitation, sessionFragment, type SessionInvitation } from "../client";
import { visitor as texts } from "../texts";

const CODE_KEY = "phalanx.code";
/** `pin` and `password` are those of links for programs in mode qrkey. */
const SECRETS = ["j", "pin", "password"];

/** What is kept of the browser: passed in, so that it can be tested without one. */
export interface Surroundings {
  readonly location: { readonly href: string };
  readonly history: { replaceState(data: null, unused: string, url: string): void };
  readonly storage: Pick<Storage, "getItem" | "setItem" | "removeItem"> | undefined;
}

export interface Found {
  readonly code?: SessionInvitation;
  readonly problem?: string;
}

/**
 * The invitation in the address, which is then removed from it; undefined if there is none.
 *
 * `problem` says in plain words why one was refused.
 */
export function takeFromAddress(at: Surroundings): Found | undefined {
  const { href } = at.location;
  const url = new URL(href);
  const words = new URLSearchParams(url.hash.slice(1));
  if (!SECRETS.some((key) => words.has(key))) return undefined;
  at.history.replaceState(null, "", `${url.pathname}${url.search}`);
  return readLink(href);
}

/** The invitation in a link that somebody pasted. */
export function readLink(text: string): Found {
  try {
    return text.includes("#j=") ? { code: parseInvitation(text) } : { problem: texts.notTheLink };
  } catch (error) {
    return { problem: error instanceof BadInvitation ? texts.linkCutOff : texts.notASwarmsLink };
  }
}

/** Keep a code until it has admitted us. */
export function keepCode(at: Surroundings, code: SessionInvitation): void {
  try {
    at.storage?.setItem(CODE_KEY, sessionFragment(code));
  } catch {
    // Storage is full or forbidden: a reload has to scan again, and nothing else is lost.
  }
}

export function forgetCode(at: Surroundings): void {
  try {
    at.storage?.removeItem(CODE_KEY);
  } catch {
    // As above.
  }
}

/** The code that this tab has not been admitted with yet. */
export function takeKept(at: Surroundings): Found {
  try {
    const code = at.storage?.getItem(CODE_KEY);
    return typeof code === "string" ? { code: parseInvitation(code) } : {};
  } catch {
    return {};
  }
}
