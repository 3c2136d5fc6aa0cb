// The map and the controls of one robot.

import { useCallback, useEffect, useState } from "react";
import { type Invitation, type Point, type SwarmLink, useCommand, useSwarm } from "../client";
import { Badge, badgeWords, hostOf } from "./badge";
import type { Wheels } from "./drive";
import { Joystick } from "./joystick";
import { Led } from "./led";
import { MapView } from "./map/map_view";
import { RobotPicker } from "./robot_picker";
import { MOST_WAYPOINTS, Route, routePayload } from "./route";
import { ShieldWords } from "./shield_words";

interface Props {
  readonly to: Invitation;
  readonly link: SwarmLink | undefined;
  readonly onLeave: () => void;
}

const NO_POINTS: readonly Point[] = [];

export function Cockpit({ to, link, onLeave }: Props) {
  const [chosen, setChosen] = useState<string>();
  const [routing, setRouting] = useState(false);
  const [draft, setDraft] = useState(NO_POINTS);
  const [threshold, setThreshold] = useState(40);
  const roster = useSwarm(link, ({ swarm }) => swarm.roster);
  const health = useSwarm(link, (view) => view.health);

  // A robot that left is no longer driven; of a single one there is nothing to choose.
  const only = roster.length === 1 ? roster[0]?.address : undefined;
  const entry = roster.find(({ address }) => address === chosen) ?? roster.find(({ address }) => address === only);
  const selected = entry?.address;
  const command = useCommand(link, selected);
  const sendWheels = useCallback(
    ({ left, right }: Wheels) => {
      command("move_raw", { left_x: 0, left_y: left, right_x: 0, right_y: right });
    },
    [command],
  );

  // Driving the only one goes on when a second joins.
  useEffect(() => {
    if (only !== undefined) setChosen((now) => now ?? only);
  }, [only]);

  // Another robot, another route: with the threshold that it has.
  useEffect(() => {
    setDraft(NO_POINTS);
    setRouting(false);
    const known = selected === undefined ? undefined : link?.view.swarm.robots.get(selected)?.threshold;
    if (known !== undefined && known >= 10) setThreshold(Math.min(known, 500));
  }, [selected, link]);

  function startRoute() {
    if (!command("waypoints", routePayload(threshold, draft))) return;
    setDraft(NO_POINTS);
    setRouting(false);
  }

  function clearRoute() {
    setDraft(NO_POINTS);
    command("waypoints", routePayload(threshold, []));
  }

  const words = badgeWords(health, hostOf(to.broker), roster.length);
  const inTrouble = words.state === "offline" || words.state === "silent";
  return (
    <>
      <header className="top">
        <p className="brand">Phalanx</p>
        <Badge {...words} />
        {inTrouble && (
          <button type="button" className="quiet" data-testid="leave" onClick={onLeave}>
            Use another code
          </button>
        )}
      </header>
      <main className="cockpit">
        <h1 className="unseen">Drive the swarm</h1>
        <MapView
          link={link}
          selected={selected}
          onSelect={setChosen}
          routing={routing}
          draft={draft}
          threshold={threshold}
          onWaypoint={(point) => setDraft((points) => [...points, point].slice(0, MOST_WAYPOINTS))}
        />
        <div className="controls">
          <RobotPicker
            link={link}
            selected={selected}
            onSelect={setChosen}
            onClearTrail={() => command("clear_position_history", "")}
          />
          <ShieldWords link={link} selected={selected} />
          <div className="hands">
            <div className="stick">
              <Joystick send={sendWheels} disabled={selected === undefined} robotName={entry?.name} />
              <p id="joystick-help" className="stick-help">
                Hold to drive, let go to stop.
                <span className="keys-help">
                  {" "}
                  By keyboard: <kbd>Tab</kbd> to it, then hold the arrow keys or <kbd>W A S D</kbd>.
                </span>
              </p>
            </div>
            <Led key={selected} link={link} selected={selected} command={command} />
          </div>
          <Route
            link={link}
            selected={selected}
            routing={routing}
            onRouting={setRouting}
            draft={draft}
            onUndo={() => setDraft((points) => points.slice(0, -1))}
            threshold={threshold}
            onThreshold={setThreshold}
            onStart={startRoute}
            onClear={clearRoute}
          />
        </div>
      </main>
    </>
  );
}
