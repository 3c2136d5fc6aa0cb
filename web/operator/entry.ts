// How this page connects: with a scanned ticket, with the token of the link that the gateway printed on this machine, or
// with the stored session of an earlier visit.

import { useCallback, useEffect, useState } from "react";
import {
  BadInvitation,
  browserStores,
  DIRECT,
  decodeBase64url,
  type Kept,
  linkUrl,
  parseInvitation,
  ResumeStore,
  type Secret,
  type SessionTo,
} from "../client";
import { Local, WrongToken } from "./local";
import { dropToken, takeToken } from "./token";

/** Address of the websocket, relative to this page on the front end. */
const ABOVE = "../link";
const AGAIN_MS = 1000;
const LINK = /^#(j|token)=/;

/** Resume secrets of operators; visitors' are stored separately. */
export const resumeStore = new ResumeStore(browserStores(), "phalanx.operator.");

export type Entry =
  | { readonly kind: "asking"; readonly tries: number }
  /** `refused`: a token or ticket was invalid. */
  | { readonly kind: "none"; readonly refused: boolean }
  | { readonly kind: "session"; readonly to: SessionTo; readonly local: Local | undefined };

/** Return the way in, and a function that looks for another one. */
export function useEntry(): readonly [Entry, () => void] {
  const [entry, setEntry] = useState<Entry>({ kind: "asking", tries: 0 });
  const [round, setRound] = useState(0);
  const again = useCallback(() => setRound((before) => before + 1), []);

  useEffect(() => {
    // A new link pasted into this tab changes only the fragment, and reloads nothing. Other fragments are parts of the page.
    const pasted = () => LINK.test(window.location.hash) && again();
    window.addEventListener("hashchange", pasted);
    return () => window.removeEventListener("hashchange", pasted);
  }, [again]);

  useEffect(() => {
    let timer: number | undefined;
    let isOver = false;
    const enter = async (tries: number) => {
      const found = await find(round > 0);
      if (isOver) return;
      if (found === undefined) {
        setEntry({ kind: "asking", tries: tries + 1 });
        timer = window.setTimeout(() => void enter(tries + 1), AGAIN_MS);
      } else setEntry(found);
    };
    void enter(0);
    return () => {
      isOver = true;
      window.clearTimeout(timer);
    };
  }, [round]);
  return [entry, again];
}

/** Undefined if the gateway does not answer. `isAgain`: the stored secret has failed. */
async function find(isAgain: boolean): Promise<Entry | undefined> {
  const ticket = takeTicket();
  if (ticket === "bad") return { kind: "none", refused: true };
  if (ticket) return session(linkUrl(window.location.href, ABOVE), ticket.fixed, ticket.secret, undefined);
  const token = takeToken();
  if (token !== undefined) return await here(new Local(token));
  const kept: Kept | undefined = resumeStore.newest(Date.now() / 1000);
  if (kept) return session(linkUrl(window.location.href, ABOVE), kept.fixed, undefined, undefined);
  return { kind: "none", refused: isAgain };
}

async function here(local: Local): Promise<Entry | undefined> {
  try {
    const where = await local.where();
    const fixed = decodeBase64url(new TextEncoder().encode(where.fixed));
    if (fixed === undefined) return { kind: "none", refused: true };
    const kept = resumeStore.find(fixed, Date.now() / 1000);
    return session(where.link, fixed, kept ? undefined : await local.ticket(), local);
  } catch (error) {
    if (!(error instanceof WrongToken)) return undefined;
    dropToken();
    return { kind: "none", refused: true };
  }
}

function session(url: string, fixed: Uint8Array, invitation: Secret | undefined, local: Local | undefined): Entry {
  return { kind: "session", to: { url, at: DIRECT, fixed, invitation, name: "" }, local };
}

/** Take the ticket from the address, and remove it there: the address bar may be on a projector. */
function takeTicket(): { readonly fixed: Uint8Array; readonly secret: Secret } | "bad" | undefined {
  const { hash, pathname, search } = window.location;
  if (!hash.startsWith("#j=")) return undefined;
  window.history.replaceState(null, "", pathname + search);
  try {
    return parseInvitation(hash);
  } catch (error) {
    if (!(error instanceof BadInvitation)) throw error;
    return "bad";
  }
}
