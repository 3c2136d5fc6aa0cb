// The operator's page, on this machine or on a tablet: the code for visitors on one half, the system's state on the
// other.

import { useEffect, useMemo, useState } from "react";
import { type OverReason, SessionConnection, type SwarmView, sentence, useLink, useSwarm } from "../client";
import { common, Mixed, operator as texts } from "../texts";
import { useFragment } from "./address";
import { useNow } from "./clock";
import { type Entry, resumeStore, useEntry } from "./entry";
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
import { LinkStation, type Station } from "./station";
import { StopAll } from "./stop_all";
import { TabletButton } from "./tablet";
import { Term, Tip } from "./terms";
import { SessionCard } from "./visitors";
import { ago } from "./words";

// By then a restart would be over, and the code on the screen is most likely invalid.
const DEAD_AFTER_MS = 5000;
/** After this time, tell an operator who restarted the gateway without --operator-port to open its new link. */
const RESTARTED_AFTER_S = 15;

export function App() {
  const [entry, again] = useEntry();
  if (entry.kind === "none") return <OpenTheLink refused={entry.refused} />;
  if (entry.kind === "session") return <Connected key={entry.to.url} entry={entry} onAgain={again} />;
  return <p className="waiting">{entry.tries < 2 ? texts.askingTheGateway : texts.tryingAgain}</p>;
}

interface ConnectedProps {
  readonly entry: Extract<Entry, { kind: "session" }>;
  readonly onAgain: () => void;
}

function Connected({ entry, onAgain }: ConnectedProps) {
  const { to, local } = entry;
  const open = useMemo(() => () => new SessionConnection(to, resumeStore), [to]);
  const link = useLink(open);
  const station = useMemo(() => link && new LinkStation(link, local), [link, local]);
  const over = useSwarm(link, ({ visit }) => visit.over);
  const isLive = useSwarm(link, isLiveOf);
  const isOperator = useSwarm(link, ({ visit }) => visit.standing === undefined || visit.standing.role === "operate");
  const isElsewhere = over === "replaced";

  useEffect(() => {
    // On this machine a new ticket can be requested.
    if (!local || over === undefined || isElsewhere) return;
    const timer = setTimeout(onAgain, 1000);
    return () => clearTimeout(timer);
  }, [local, over, isElsewhere, onAgain]);

  useEffect(() => {
    if (!local || isLive) return;
    // The gateway may have been restarted at another address.
    const timer = setInterval(() => {
      local.where().then(
        ({ link: url }) => url !== to.url && onAgain(),
        () => {},
      );
    }, DEAD_AFTER_MS);
    return () => clearInterval(timer);
  }, [local, isLive, to, onAgain]);

  if (isElsewhere) return <Elsewhere onHere={() => link?.transport.again()} />;
  if (!isOperator || (over !== undefined && !local)) return <OpenTheLink refused over={over} />;
  if (!station) return null;
  return <Desk station={station} isOnTablet={local === undefined} />;
}

const isLiveOf = ({ health }: SwarmView) => health.state === "live";

interface DeskProps {
  readonly station: Station;
  readonly isOnTablet: boolean;
}

export function Desk({ station, isOnTablet }: DeskProps) {
  const polled = useGateway(station);
  const exhibition = useExhibition();
  const { newest, trouble } = polled;
  const window = useWindow(newest);
  const [drawing, setDrawing] = useFragment("#mission");
  const [wasOpened, setWasOpened] = useState(false);
  if (drawing && !wasOpened) setWasOpened(true);
  const silent_ms = useNow(1000) - (newest?.at_ms ?? 0);

  const dead = trouble !== undefined && silent_ms > DEAD_AFTER_MS;
  return (
    <div className="page" data-tablet={isOnTablet} data-exhibition={exhibition.on} data-trouble={trouble !== undefined}>
      {!exhibition.on && (
        <Header station={station} state={newest?.state} drawing={drawing} onDrawing={setDrawing} isOnTablet={isOnTablet} />
      )}
      <StopAll station={station} held={newest?.state.held === true} heardAt_ms={newest?.at_ms ?? 0} />
      <Banner polled={polled} silent_s={silent_ms / 1000} />
      {/* Once opened it stays mounted, hidden: a draft must survive a look at the overview. */}
      {wasOpened && newest?.state.mission && (
        <div hidden={!drawing}>
          <Editor station={station} running={newest.state.mission.running} />
        </div>
      )}
      {newest && !(drawing && newest.state.mission) && (
        <main>
          <div className="stage">
            <Invitation
              station={station}
              newest={newest}
              outOfOrder={dead ? texts.backInAMoment : undefined}
              exhibition={exhibition}
            />
            {!exhibition.on && (
              <div className="middle">
                <LiveMap station={station} state={newest.state} />
                {newest.state.session && (
                  <SessionCard station={station} session={newest.state.session} robots={newest.state.robots} />
                )}
              </div>
            )}
            {!exhibition.on && <Show station={station} state={newest.state} />}
          </div>
          {!exhibition.on && (
            <div className="overview">
              <Fleet source={station.source} robots={newest.state.robots} shields={newest.state.shields} mission={newest.state.mission} />
              <div className="pair roomy">
                <CountersCard counters={newest.state.counters} window={window} />
                <Rejections rejected={newest.state.rejected} window={window} />
              </div>
              {newest.state.broker.name !== "direct" && <BrokerCard broker={newest.state.broker} />}
            </div>
          )}
        </main>
      )}
      {!newest && !trouble && <p className="waiting">{texts.askingTheGateway}</p>}
      <Tip />
    </div>
  );
}

/** The part for an audience: map and attacks. */
function Show({ station, state }: { readonly station: Station; readonly state: GatewayState }) {
  const { robots, shields, unprotected, mission, visitors, session, mode } = state;
  const isShared = session === undefined || mode === "qrkey";
  return (
    <div className="show">
      {shields && <CompromiseCard station={station} robots={robots} shields={shields} />}
      {shields && <AuditsCard refusals={shields.refusals} />}
      {mission && <MissionCard mission={mission} />}
      {!shields && !mission && <UnprotectedCard why={unprotected} />}
      {isShared && <VisitorsCard visitors={visitors} />}
    </div>
  );
}

interface HeaderProps {
  readonly station: Station;
  readonly state: GatewayState | undefined;
  readonly drawing: boolean;
  readonly onDrawing: (on: boolean) => void;
  readonly isOnTablet: boolean;
}

function Header({ station, state, drawing, onDrawing, isOnTablet }: HeaderProps) {
  return (
    <header className="top">
      {/* The overview has its own heading. */}
      <p className="brand" {...(drawing && { role: "heading", "aria-level": 1 })}>
        <img src="./icon.svg" alt="" width="28" height="28" />
        {common.brand} <span className="quiet">{texts.operator}</span>
      </p>
      {state?.mission && (
        <button
          type="button"
          className="mission-button"
          data-testid="to-editor"
          aria-pressed={drawing}
          onClick={() => onDrawing(!drawing)}
        >
          {texts.missionEditor}
        </button>
      )}
      {!isOnTablet && <TabletButton station={station} />}
      {state && (
        <p className="quiet">
          <Term of="mode">{texts.mode}</Term> <span className="mono">{state.mode}</span> · {texts.upFor(ago(Math.max(1, state.uptime_s)))}
        </p>
      )}
    </header>
  );
}

function Banner({ polled, silent_s }: { readonly polled: Polled; readonly silent_s: number }) {
  const { newest, trouble } = polled;
  let text: string | undefined;
  if (trouble === "unreachable")
    text = silent_s < RESTARTED_AFTER_S ? texts.retrying : texts.retryingLong;
  else if (trouble === "incomprehensible") text = texts.otherVersion;
  else if (newest && !newest.state.broker.connected)
    text = texts.lostItsBroker(newest.state.broker.trouble || texts.noAnswer);
  else if (newest && newest.state.broker.phones !== "") text = sentence(newest.state.broker.phones);
  if (text === undefined) return null;
  return (
    <p className="banner" role="alert" data-testid="banner">
      {text}
      {/* Not read out: an alert is announced anew with every change, and this one changes every second. */}
      {trouble && newest && <span aria-hidden="true">{texts.lastHeard(ago(Math.max(1, silent_s)))}</span>}
    </p>
  );
}

function OpenTheLink({ refused, over }: { readonly refused: boolean; readonly over?: OverReason | undefined }) {
  const why: Partial<Record<OverReason, string>> = texts.over;
  return (
    <main className="open-the-link" data-testid="no-token">
      <img src="./icon.svg" alt="" width="64" height="64" />
      <h1>{texts.needsALink}</h1>
      <p>{(over && why[over]) ?? (refused ? texts.notValid : "")}</p>
      <p>
        <Mixed parts={texts.scanAnOperatorsCode(<span className="mono">{"phalanx link invite --role operator"}</span>)} />
      </p>
      <p>
        <Mixed parts={texts.openTheLine(<span className="mono">{"http://127.0.0.1"}</span>)} />
      </p>
    </main>
  );
}

function Elsewhere({ onHere }: { readonly onHere: () => void }) {
  return (
    <main className="open-the-link" data-testid="elsewhere">
      <h1>{texts.openInAnotherTab}</h1>
      <button type="button" className="primary" onClick={onHere}>
        {texts.useItHere}
      </button>
    </main>
  );
}
