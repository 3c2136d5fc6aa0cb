// The operator's page: the code for the visitors on one half, the state of everything on the other.

import { useEffect, useState } from "react";
import { sentence } from "../client";
import { useNow } from "./clock";
import { useExhibition } from "./exhibition";
import { Fleet } from "./fleet";
import type { GatewayState } from "./gateway_state";
import { Invitation } from "./invitation";
import { BrokerCard, CountersCard, VisitorsCard } from "./link_health";
import { LiveMap } from "./live_map";
import { MissionCard } from "./mission/card";
import { Editor } from "./mission/editor";
import { type Polled, useGateway } from "./poll";
import { useWindow } from "./rates";
import { Rejections } from "./rejections";
import { AuditsCard, CompromiseCard, UnprotectedCard } from "./shields";
import { StopAll } from "./stop_all";
import { Term, Tip } from "./terms";
import { SessionCard } from "./visitors";
import { takeToken } from "./token";
import { ago } from "./words";

// A restart of the gateway is over by then; after it, a code on the screen most likely opens nothing.
const DEAD_AFTER_MS = 5000;
/** Whoever started it again without --operator-port waits here for nothing. */
const RESTARTED_AFTER_S = 15;

export function App() {
  const token = useToken();
  const polled = useGateway(token);
  const exhibition = useExhibition();
  const { newest, trouble, refused } = polled;
  const window = useWindow(newest);
  const [drawing, setDrawing] = useState<boolean>();
  const silent_ms = useNow(1000) - (newest?.at_ms ?? 0);

  if (token === undefined || refused) return <OpenTheLink refused={refused} />;
  const dead = trouble !== undefined && silent_ms > DEAD_AFTER_MS;
  return (
    <div className="page" data-exhibition={exhibition.on} data-trouble={trouble !== undefined}>
      {!exhibition.on && <Header state={newest?.state} drawing={drawing === true} onDrawing={setDrawing} />}
      <StopAll token={token} held={newest?.state.held === true} heardAt_ms={newest?.at_ms ?? 0} />
      <Banner polled={polled} silent_s={silent_ms / 1000} />
      {/* Once opened it stays, hidden: what is drawn must not be lost to a look at the overview. */}
      {drawing !== undefined && newest?.state.mission && (
        <div hidden={!drawing}>
          <Editor token={token} running={newest.state.mission.running} />
        </div>
      )}
      {newest && !drawing && (
        <main>
          <div className="stage">
            <Invitation
              token={token}
              newest={newest}
              outOfOrder={dead ? "Back in a moment" : undefined}
              exhibition={exhibition}
            />
            {!exhibition.on && (
              <div className="middle">
                <LiveMap token={token} state={newest.state} />
                {newest.state.session && (
                  <SessionCard token={token} session={newest.state.session} robots={newest.state.robots} />
                )}
              </div>
            )}
            {!exhibition.on && <Show token={token} state={newest.state} />}
          </div>
          {!exhibition.on && (
            <div className="overview">
              <Fleet robots={newest.state.robots} shields={newest.state.shields} mission={newest.state.mission} />
              <div className="pair roomy">
                <CountersCard counters={newest.state.counters} window={window} />
                <Rejections rejected={newest.state.rejected} window={window} />
              </div>
              {newest.state.broker.name !== "direct" && <BrokerCard broker={newest.state.broker} />}
            </div>
          )}
        </main>
      )}
      {!newest && !trouble && <p className="waiting">Asking the gateway…</p>}
      <Tip />
    </div>
  );
}

/** What one does, and talks about, before an audience. */
function Show({ token, state }: { readonly token: string; readonly state: GatewayState }) {
  const { robots, shields, unprotected, mission, visitors, session, mode } = state;
  const isShared = session === undefined || mode === "qrkey";
  return (
    <div className="show">
      {shields && <CompromiseCard token={token} robots={robots} shields={shields} />}
      {shields && <AuditsCard refusals={shields.refusals} />}
      {mission && <MissionCard mission={mission} />}
      {!shields && !mission && <UnprotectedCard why={unprotected} />}
      {isShared && <VisitorsCard visitors={visitors} />}
    </div>
  );
}

function useToken(): string | undefined {
  const [token, setToken] = useState(takeToken);
  useEffect(() => {
    // A new link pasted into this tab changes only the fragment, and loads nothing.
    const onHash = () => setToken(takeToken());
    window.addEventListener("hashchange", onHash);
    return () => window.removeEventListener("hashchange", onHash);
  }, []);
  return token;
}

interface HeaderProps {
  readonly state: GatewayState | undefined;
  readonly drawing: boolean;
  readonly onDrawing: (on: boolean) => void;
}

function Header({ state, drawing, onDrawing }: HeaderProps) {
  return (
    <header className="top">
      {/* The overview has a heading of its own. */}
      <p className="brand" {...(drawing && { role: "heading", "aria-level": 1 })}>
        <img src="./icon.svg" alt="" width="28" height="28" />
        Phalanx <span className="quiet">operator</span>
      </p>
      {state?.mission && (
        <button
          type="button"
          className="mission-button"
          data-testid="to-editor"
          aria-pressed={drawing}
          onClick={() => onDrawing(!drawing)}
        >
          Mission editor
        </button>
      )}
      {state && (
        <p className="quiet">
          <Term of="mode">mode</Term> <span className="mono">{state.mode}</span> · up {ago(Math.max(1, state.uptime_s))}
        </p>
      )}
    </header>
  );
}

function Banner({ polled, silent_s }: { readonly polled: Polled; readonly silent_s: number }) {
  const { newest, trouble } = polled;
  let text: string | undefined;
  if (trouble === "unreachable")
    text =
      silent_s < RESTARTED_AFTER_S
        ? "Gateway not answering, retrying"
        : "Gateway not answering, retrying. If it was started again, open the operator link that it printed then";
  else if (trouble === "incomprehensible") text = "Gateway and page are of different versions: reload this page";
  else if (newest && !newest.state.broker.connected)
    text = `The gateway has lost its broker (${newest.state.broker.trouble || "no answer"}), retrying: no visitor gets through`;
  else if (newest && newest.state.broker.phones !== "") text = sentence(newest.state.broker.phones);
  if (text === undefined) return null;
  return (
    <p className="banner" role="alert" data-testid="banner">
      {text}
      {/* Not read out: an alert is announced anew with every change, and this one changes every second. */}
      {trouble && newest && <span aria-hidden="true"> · last heard {ago(Math.max(1, silent_s))} ago</span>}
    </p>
  );
}

function OpenTheLink({ refused }: { readonly refused: boolean }) {
  return (
    <main className="open-the-link" data-testid="no-token">
      <img src="./icon.svg" alt="" width="64" height="64" />
      <h1>Open the operator link printed in the terminal</h1>
      <p>
        {refused
          ? "The gateway does not accept this page’s link. It makes a new one each time it starts, unless --operator-token-file keeps it."
          : "This page needs the link that the gateway prints when it starts."}{" "}
        Look for the line that begins with <span className="mono">http://127.0.0.1</span> and open all of it, to the
        last character.
      </p>
    </main>
  );
}
