// The visitor page: with an invitation it drives the swarm, without one it explains how to get one.

import { useCallback, useEffect, useState } from "react";
import {
  DIRECT,
  fetchSwarmKey,
  type Kept,
  linkUrl,
  type Secret,
  type SessionInvitation,
  type SessionTo,
  type SessionWhere,
  WebsocketWay,
} from "../client";
import { visitor as texts } from "../texts";
import { Frame } from "./frame";
import { type Found, forgetCode, keepCode, type Surroundings, takeFromAddress, takeKept } from "./invitation_store";
import { Join } from "./join";
import { latePart } from "./late_part";
import { NoCode } from "./no_code";
import { resumeStore } from "./resumes";

const storage = sessionStorageOrNone();
const browser: Surroundings = { location: window.location, history: window.history, storage };
/** Loaded while the visitor reads how to join. */
const Visit = latePart(
  async () => (await import("./visit")).Visit,
  () => <Frame state="connecting" text={texts.connecting} />,
);

type Entry =
  | { readonly kind: "none"; readonly problem?: string | undefined }
  /** A session's code was found, and the page asks for a nickname. */
  | { readonly kind: "naming"; readonly code: SessionInvitation }
  | { readonly kind: "session"; readonly to: SessionTo; readonly way: WebsocketWay | undefined };

export function App() {
  const [entry, setEntry] = useState<Entry>(() => enter(takeFromAddress(browser) ?? takeKept(browser)));

  useEffect(() => {
    // Scanning again in the same tab changes only the fragment.
    const onHash = () => {
      const taken = takeFromAddress(browser);
      if (!taken) return;
      const next = enter(taken);
      // A bad link does not end the visitor's current connection.
      setEntry((now) => (next.kind !== "none" || now.kind === "none" ? next : now));
    };
    window.addEventListener("hashchange", onHash);
    return () => window.removeEventListener("hashchange", onHash);
  }, []);

  const use = useCallback(() => forgetCode(browser), []);
  const refuse = useCallback(() => setEntry((now) => ({ kind: "none", problem: codeProblem(now) })), []);
  const leave = useCallback(() => {
    forgetCode(browser);
    setEntry({ kind: "none" });
  }, []);

  async function joinRoom(secret: Secret, nickname: string): Promise<string | undefined> {
    const fixed = await fetchSwarmKey(location.href);
    if (!fixed) return texts.noRoomCodes;
    setEntry(session(DIRECT, fixed, secret, nickname));
    return undefined;
  }

  switch (entry.kind) {
    case "naming": {
      const { code } = entry;
      return (
        <Frame state="nocode" text={texts.readyToJoin}>
          <Join storage={storage} onJoin={(nickname) => setEntry(session(code, code.fixed, code.secret, nickname))} />
        </Frame>
      );
    }
    case "none":
      return (
        <Frame state="nocode" text={texts.noCodeYet}>
          <NoCode
            problem={entry.problem}
            storage={storage}
            onFound={(found) => setEntry(enter(found))}
            onRoom={joinRoom}
          />
        </Frame>
      );
    case "session":
      return <Visit to={entry.to} way={entry.way} onUsed={use} onRefused={refuse} onLeave={leave} />;
  }
}

function codeProblem(entry: Entry): string {
  const isRoom = entry.kind === "session" && entry.to.invitation?.kind === "room";
  return isRoom ? texts.roomCodeWrong : texts.codeNotValid;
}

/** What to do with a found code: a known visitor resumes, unless a ticket gives more rights. */
function enter({ code, problem }: Found): Entry {
  if (code) {
    const kept = resumeStore.find(code.fixed, Date.now() / 1000);
    if (kept && code.secret.kind === "open") return session(code, code.fixed, code.secret, kept.name);
    keepCode(browser, code);
    return { kind: "naming", code };
  }
  const kept: Kept | undefined = problem === undefined ? resumeStore.newest(Date.now() / 1000) : undefined;
  return kept ? session(kept.at, kept.fixed, undefined, kept.name) : { kind: "none", problem };
}

/** Begin a session, and with it its websocket: that takes two round trips, while `visit` may be loading still. */
function session(at: SessionWhere, fixed: Uint8Array, invitation: Secret | undefined, name: string): Entry {
  const url = linkUrl(location.href);
  const way = at.broker === "" ? new WebsocketWay(url) : undefined;
  return { kind: "session", to: { url, at, fixed, invitation, name }, way };
}

function sessionStorageOrNone(): Storage | undefined {
  try {
    return window.sessionStorage;
  } catch {
    // Reading the property throws if site data is forbidden.
    return undefined;
  }
}
