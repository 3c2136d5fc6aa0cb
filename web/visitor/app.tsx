// The visitor page: with an invitation it drives the swarm, without one it explains how to get one.

import { type ReactNode, useCallback, useEffect, useMemo, useState } from "react";
import {
  DIRECT,
  fetchSwarmKey,
  type Kept,
  linkUrl,
  type Secret,
  type SessionConnection,
  type SessionInvitation,
  type SessionTo,
  type SessionWhere,
  useLink,
  useSwarm,
} from "../client";
import { common, visitor as texts } from "../texts";
import { Badge, hostOf } from "./badge";
import { Cockpit } from "./cockpit";
import { type Found, forgetCode, keepCode, type Surroundings, takeFromAddress, takeKept } from "./invitation_store";
import { Join } from "./join";
import { NoCode } from "./no_code";
import { openSession, resumeStore } from "./open_link";
import { Over, WaitingForApproval } from "./over";

const storage = sessionStorageOrNone();
const browser: Surroundings = { location: window.location, history: window.history, storage };

type Entry =
  | { readonly kind: "none"; readonly problem?: string | undefined }
  /** A session's code was found, and the page asks for a nickname. */
  | { readonly kind: "naming"; readonly code: SessionInvitation }
  | { readonly kind: "session"; readonly to: SessionTo };

export function App() {
  const [entry, setEntry] = useState<Entry>(() => enter(takeFromAddress(browser) ?? takeKept(browser)));
  const open = useMemo(() => opener(entry), [entry]);
  const link = useLink(open);
  const isSession = entry.kind === "session";
  const stage = useSwarm(link, ({ visit }) => visit.stage);
  const over = useSwarm(link, ({ visit }) => visit.over);
  const isWaiting = useSwarm(link, ({ visit }) => visit.standing?.waiting === true);
  const name = useSwarm(link, ({ visit }) => visit.name);

  useEffect(() => {
    // A used or refused code cannot be used again: a reload resumes.
    if (isSession && (stage === "here" || over === "code")) forgetCode(browser);
  }, [isSession, stage, over]);

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

  const leave = useCallback(() => {
    forgetCode(browser);
    setEntry((now) => {
      if (now.kind === "session") resumeStore.forget(now.to.fixed);
      return { kind: "none" };
    });
  }, []);

  async function joinRoom(secret: Secret, nickname: string): Promise<string | undefined> {
    const fixed = await fetchSwarmKey(location.href);
    if (!fixed) return texts.noRoomCodes;
    setEntry({ kind: "session", to: sessionTo(DIRECT, fixed, secret, nickname) });
    return undefined;
  }

  function again() {
    link?.transport.again();
  }

  if (entry.kind === "naming") {
    const { code } = entry;
    return (
      <Frame state="nocode" text={texts.readyToJoin}>
        <Join
          storage={storage}
          onJoin={(nickname) => setEntry({ kind: "session", to: sessionTo(code, code.fixed, code.secret, nickname) })}
        />
      </Frame>
    );
  }
  if (entry.kind === "none" || over === "code") {
    const problem = entry.kind === "none" ? entry.problem : codeProblem(entry);
    return (
      <Frame state="nocode" text={texts.noCodeYet}>
        <NoCode problem={problem} storage={storage} onFound={(found) => setEntry(enter(found))} onRoom={joinRoom} />
      </Frame>
    );
  }
  if (over !== undefined)
    return (
      <Frame state="over" text={texts.sessionEnded}>
        <Over reason={over} onAgain={again} onLeave={leave} />
      </Frame>
    );
  if (isWaiting)
    return (
      <Frame state="waiting" text={texts.waitingForTheOperator}>
        <WaitingForApproval name={name} />
      </Frame>
    );
  const { broker } = entry.to.at;
  const where =
    broker !== ""
      ? { via: "broker" as const, host: hostOf(broker) }
      : { via: "direct" as const, host: hostOf(entry.to.url) };
  return (
    <div className="page">
      <Cockpit where={where} link={link} onLeave={leave} />
    </div>
  );
}

interface FrameProps {
  readonly state: "nocode" | "over" | "waiting";
  readonly text: string;
  readonly children: ReactNode;
}

function Frame({ state, text, children }: FrameProps) {
  return (
    <div className="page">
      <header className="top">
        <p className="brand">{common.brand}</p>
        <div className="status">
          <Badge state={state} text={text} />
        </div>
      </header>
      {children}
    </div>
  );
}

function codeProblem(entry: Entry): string {
  const isRoom = entry.kind === "session" && entry.to.invitation?.kind === "room";
  return isRoom ? texts.roomCodeWrong : texts.codeNotValid;
}

/** What to do with a found code: a known visitor resumes, unless a ticket gives more rights. */
function enter({ code, problem }: Found): Entry {
  if (code) {
    const kept = resumeStore.find(code.fixed, Date.now() / 1000);
    if (kept && code.secret.kind === "open") return { kind: "session", to: sessionTo(code, code.fixed, code.secret, kept.name) };
    keepCode(browser, code);
    return { kind: "naming", code };
  }
  const kept: Kept | undefined = problem === undefined ? resumeStore.newest(Date.now() / 1000) : undefined;
  return kept ? { kind: "session", to: sessionTo(kept.at, kept.fixed, undefined, kept.name) } : { kind: "none", problem };
}

function sessionTo(at: SessionWhere, fixed: Uint8Array, invitation: Secret | undefined, name: string): SessionTo {
  return { url: linkUrl(location.href), at, fixed, invitation, name };
}

function opener(entry: Entry): (() => Promise<SessionConnection>) | undefined {
  return entry.kind === "session" ? () => openSession(entry.to) : undefined;
}

function sessionStorageOrNone(): Storage | undefined {
  try {
    return window.sessionStorage;
  } catch {
    // Reading the property throws if site data is forbidden.
    return undefined;
  }
}
