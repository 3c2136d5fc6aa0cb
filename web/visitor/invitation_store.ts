// Where the page finds its invitation, and how it hides its secret.
//
// From the address, which is cleaned at once so that no history, screenshot or shared link has it; otherwise from this
// tab's session storage, where a code is kept until it has admitted the visitor.

import { BadInvitation, parseInvitation, sessionFragment, type SessionInvitation } from "../client";
import { visitor as texts } from "../texts";

const CODE_KEY = "phalanx.code";
/** `pin` and `password` are in links for programs in mode qrkey. */
const SECRETS = ["j", "pin", "password"];

/** The browser's objects in use: passed in for tests. */
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
 * Take the invitation from the address, and remove it there; undefined if there is none.
 *
 * `problem` has the reason if it was refused.
 */
export function takeFromAddress(at: Surroundings): Found | undefined {
  const { href } = at.location;
  const url = new URL(href);
  const words = new URLSearchParams(url.hash.slice(1));
  if (!SECRETS.some((key) => words.has(key))) return undefined;
  at.history.replaceState(null, "", `${url.pathname}${url.search}`);
  return readLink(href);
}

/** The invitation in a pasted link. */
export function readLink(text: string): Found {
  try {
    return text.includes("#j=") ? { code: parseInvitation(text) } : { problem: texts.notTheLink };
  } catch (error) {
    return { problem: error instanceof BadInvitation ? texts.linkCutOff : texts.notASwarmsLink };
  }
}

/** Keep a code until it has admitted the visitor. */
export function keepCode(at: Surroundings, code: SessionInvitation): void {
  try {
    at.storage?.setItem(CODE_KEY, sessionFragment(code));
  } catch {
    // Storage is full or forbidden: after a reload the visitor has to scan again.
  }
}

export function forgetCode(at: Surroundings): void {
  try {
    at.storage?.removeItem(CODE_KEY);
  } catch {
    // As above.
  }
}

/** The code that has not admitted this tab yet. */
export function takeKept(at: Surroundings): Found {
  try {
    const code = at.storage?.getItem(CODE_KEY);
    return typeof code === "string" ? { code: parseInvitation(code) } : {};
  } catch {
    return {};
  }
}
