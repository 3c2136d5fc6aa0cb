// Where the page finds its invitation, and how it keeps its secret out of sight.
//
// From the address (and removed from it at once, so that it stays in no history, screenshot or shared link), else from
// this tab's session storage. There the code of a session is kept until it has admitted us; of mode qrkey the newest pin
// and the visitors' login, so that a reload goes on after rotations.

import {
  type BrokerLogin,
  checkedLogin,
  DEFAULT_ROOT,
  type Invitation,
  invitation,
  type Pin,
  PUBLISHED_KEYS,
  parseInvitation,
  parseQrUrl,
  sessionFragment,
  type SessionInvitation,
  UsageError,
} from "../client";

const KEY = "phalanx.invitation";
const CODE_KEY = "phalanx.code";
// A link that was cut off has no pin, and may have a login all the same.
const SECRET_IN_FRAGMENT = ["j", "v", "pin", "user", "password"];
const SECRET_IN_QUERY = ["pin", "mqtt_username", "mqtt_password"];

/** What is kept of the browser: passed in, so that it can be tested without one. */
export interface Surroundings {
  readonly location: { readonly href: string };
  readonly history: { replaceState(data: null, unused: string, url: string): void };
  readonly storage: Pick<Storage, "getItem" | "setItem" | "removeItem"> | undefined;
}

interface Kept {
  readonly pin: string;
  readonly broker: string;
  readonly root: string;
  readonly mqtt: number;
  readonly login?: BrokerLogin;
}

/** `code`: of a session; `to`: of mode qrkey. */
export interface Found {
  readonly code?: SessionInvitation;
  readonly to?: Invitation;
  readonly problem?: string;
}

/**
 * The invitation in the address, which is then removed from it; undefined if there is none.
 *
 * `problem` says in plain words why one was refused.
 */
export function takeFromAddress(at: Surroundings): Found | undefined {
  const { href } = at.location;
  const clean = withoutSecrets(href);
  if (clean === undefined) return undefined;
  at.history.replaceState(null, "", clean);
  return readLink(href);
}

/** The invitation in a link that somebody pasted. `root` is for the published form, which does not name one. */
export function readLink(text: string, root: string = DEFAULT_ROOT): Found {
  try {
    return text.includes("#j=") ? { code: parseInvitation(text) } : { to: parseQrUrl(text.trim(), root) };
  } catch (error) {
    // Only our own messages are shown: they never repeat the link.
    return { problem: error instanceof UsageError ? error.message : "this is not a swarm's link" };
  }
}

/** The invitation in what somebody typed. */
export function readTyped(pin: string, broker: string, root: string, mqtt: string, user = "", password = ""): Found {
  try {
    const login = checkedLogin(user.trim(), password);
    return { to: invitation(pin.replace(/\s/g, ""), broker.trim(), root.trim(), mqtt, login) };
  } catch (error) {
    return { problem: error instanceof UsageError ? error.message : "these words do not make an invitation" };
  }
}

/** Keep a session's code until it has admitted us. */
export function keepCode(at: Surroundings, code: SessionInvitation): void {
  try {
    at.storage?.setItem(CODE_KEY, sessionFragment(code));
  } catch {
    // As below.
  }
}

export function forgetCode(at: Surroundings): void {
  try {
    at.storage?.removeItem(CODE_KEY);
  } catch {
    // As below.
  }
}

export function keep(at: Surroundings, to: Invitation, pin: Pin = to.pin): void {
  const { broker, root, mqtt, login } = to;
  try {
    at.storage?.setItem(KEY, JSON.stringify({ pin: pin.reveal(), broker, root, mqtt, login }));
  } catch {
    // Storage is full or forbidden: a reload has to scan again, and nothing else is lost.
  }
}

export function forget(at: Surroundings): void {
  try {
    at.storage?.removeItem(KEY);
  } catch {
    // As above.
  }
}

/** The invitation that this tab used last. */
export function takeKept(at: Surroundings): Found {
  try {
    const code = at.storage?.getItem(CODE_KEY);
    if (typeof code === "string") return { code: parseInvitation(code) };
    const words = JSON.parse(at.storage?.getItem(KEY) ?? "null") as Kept | null;
    return words ? { to: invitation(words.pin, words.broker, words.root, String(words.mqtt), words.login) } : {};
  } catch {
    return {};
  }
}

/** The address without an invitation, or what is left of one; undefined if there is none in it. */
function withoutSecrets(href: string): string | undefined {
  const url = new URL(href);
  const inFragment = new URLSearchParams(url.hash.slice(1));
  const { searchParams: inQuery } = url;
  const found = SECRET_IN_FRAGMENT.some((key) => inFragment.has(key)) || SECRET_IN_QUERY.some((key) => inQuery.has(key));
  if (!found) return undefined;
  url.hash = "";
  for (const key of PUBLISHED_KEYS) url.searchParams.delete(key);
  return `${url.pathname}${url.search}`;
}
