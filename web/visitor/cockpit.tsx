// The map and the controls of one robot.

import { useCallback, useEffect, useState } from "react";
import { type Point, type SwarmLink, useCommand, useSwarm } from "../client";
import { common, Mixed, visitor as texts } from "../texts";
import { Badge, badgeWords, type Where } from "./badge";
import type { Wheels } from "./drive";
import { Joystick } from "./joystick";
import { Led } from "./led";
import { MapView } from "../map/map_view";
import { MissionWords } from "./mission_words";
import { useNews } from "./news";
import { RobotPicker } from "./robot_picker";
import { Route, routePayload } from "./route";
import { ShieldWords } from "./shield_words";
import { mayDrive, refusedWords } from "./visit_words";

interface Props {
  readonly where: Where;
  readonly link: SwarmLink | undefined;
  readonly onLeave: () => void;
}

const NO_POINTS: readonly Point[] = [];

export function Cockpit({ where, link, onLeave }: Props) {
  const [chosen, setChosen] = useState<string>();
  const [routing, setRouting] = useState(false);
  const [draft, setDraft] = useState(NO_POINTS);
  const [threshold, setThreshold] = useState(40);
  const roster = useSwarm(link, ({ swarm }) => swarm.roster);
  const health = useSwarm(link, (view) => view.health);
  const mostWaypoints = useSwarm(link, ({ swarm }) => swarm.mostWaypoints);
  const onMission = useSwarm(link, ({ swarm }) => swarm.missions !== undefined);

  // A robot that left is no longer driven; a single one needs no choice.
  const only = roster.length === 1 ? roster[0]?.address : undefined;
  const entry = roster.find(({ address }) => address === chosen) ?? roster.find(({ address }) => address === only);
  const selected = entry?.address;
  const stopped = useSwarm(link, ({ swarm }) => swarm.robots.get(selected ?? "")?.shield?.safeMode === true);
  const held = useSwarm(link, ({ swarm }) => swarm.held);
  const drives = useSwarm(link, ({ visit }) => mayDrive(visit));
  const name = useSwarm(link, ({ visit }) => visit.name);
  const own = useSwarm(link, ({ visit }) => visit.standing?.robot ?? "");
  const refused = useSwarm(link, ({ visit, swarm }) => refusedWords(visit, swarm.at_ms));
  // A robot in Safe Mode ignores commands; so do all robots while they are held or unreachable.
  const isLive = health.state === "live" && !held && drives;
  const steered = stopped ? undefined : selected;
  const obeying = isLive ? steered : undefined;
  const [sentOnRoutes] = useState(() => new Map<string, Point>());
  const news = useNews(link, selected, sentOnRoutes);
  const command = useCommand(link, selected);
  const sendWheels = useCallback(
    ({ left, right }: Wheels) => {
      command("move_raw", { left_x: 0, left_y: left, right_x: 0, right_y: right });
    },
    [command],
  );

  // The assigned robot.
  useEffect(() => {
    if (own !== "") setChosen(own);
  }, [own]);

  // The only robot stays chosen when a second one joins.
  useEffect(() => {
    if (only !== undefined) setChosen((now) => now ?? only);
  }, [only]);

  // Another robot starts a new route, with its own threshold; a stopped robot has none.
  useEffect(() => {
    setDraft(NO_POINTS);
    setRouting(false);
    const known = steered === undefined ? undefined : link?.view.swarm.robots.get(steered)?.threshold;
    if (known !== undefined && known >= 10) setThreshold(Math.min(known, 500));
  }, [steered, link]);

  function startRoute() {
    if (!command("waypoints", routePayload(threshold, draft))) return;
    const end = draft.at(-1);
    if (end) sentOnRoutes.set(selected ?? "", end);
    setDraft(NO_POINTS);
    setRouting(false);
  }

  function stopRoute() {
    sentOnRoutes.delete(selected ?? "");
    command("waypoints", routePayload(threshold, []));
  }

  const words = badgeWords(health, where, roster.length, held);
  const inTrouble = words.state === "offline" || words.state === "silent";
  return (
    <div className="page">
      <header className="top" data-state={words.state}>
        <p className="brand" data-testid="me">
          {name === "" ? common.brand : name}
        </p>
        <div className="status">
          <Badge {...words} />
          {inTrouble && (
            <button type="button" className="quiet" data-testid="leave" onClick={onLeave}>
              {texts.useAnotherCode}
            </button>
          )}
        </div>
      </header>
      <main className="cockpit">
        <h1 className="unseen">{onMission ? texts.watchTheMission : texts.driveTheSwarm}</h1>
        <MapView
          link={link}
          selected={selected}
          onSelect={setChosen}
          finds
          routing={routing}
          draft={draft}
          threshold={threshold}
          news={refused || news}
          onWaypoint={(point) => setDraft((points) => [...points, point].slice(0, mostWaypoints))}
        />
        <div className="controls">
          <div className="facts">
            <RobotPicker
              link={link}
              selected={selected}
              onSelect={setChosen}
              obeys={obeying !== undefined}
              onClearTrail={() => command("clear_position_history", "")}
              route={onMission ? undefined : { tapping: routing, onTapping: setRouting, onStop: stopRoute }}
            />
            <ShieldWords link={link} selected={selected} />
            <MissionWords link={link} selected={selected} />
          </div>
          {onMission ? (
            <Led key={selected} link={link} selected={obeying} command={command} />
          ) : routing ? (
            <Route
              link={link}
              disabled={obeying === undefined}
              draft={draft}
              onUndo={() => setDraft((points) => points.slice(0, -1))}
              threshold={threshold}
              onThreshold={setThreshold}
              onStart={startRoute}
            />
          ) : (
              <div className="hands">
                <div className="stick">
                  <Joystick send={sendWheels} disabled={obeying === undefined} robotName={entry?.name} />
                  <p id="joystick-help" className="stick-help">
                    {texts.holdToDrive}
                    <span className="keys-help">
                      {" "}
                      <Mixed parts={texts.byKeyboard(<kbd>Tab</kbd>, <kbd>W A S D</kbd>)} />
                    </span>
                  </p>
                </div>
                <Led key={selected} link={link} selected={obeying} command={command} />
              </div>
          )}
        </div>
      </main>
    </div>
  );
}
