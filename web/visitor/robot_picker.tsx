// Choose a robot from the list, with a line about it and its actions.

import { useEffect, useState } from "react";
import { ACTIVE, driversOf, INACTIVE, label, type SwarmLink, type SwarmView, useSwarm } from "../client";
import { MarkChip } from "../map/mark_chip";
import { common, visitor as texts } from "../texts";
import { standingWords } from "./visit_words";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly onSelect: (address: string | undefined) => void;
  /** Whether the robot accepts commands now. */
  readonly obeys: boolean;
  readonly onClearTrail: () => void;
  /** Undefined if robots take no routes. */
  readonly route: { readonly tapping: boolean; readonly onTapping: (on: boolean) => void; readonly onStop: () => void } | undefined;
}

export function RobotPicker({ link, selected, onSelect, obeys, onClearTrail, route }: Props) {
  const roster = useSwarm(link, ({ swarm }) => swarm.roster);
  const own = useSwarm(link, ({ visit }) => visit.standing?.robot ?? "");
  const isUnderWay = useSwarm(link, ({ swarm }) => (swarm.robots.get(selected ?? "")?.waypoints.length ?? 0) > 0);
  const number = useSwarm(link, ({ swarm }) => swarm.robots.get(selected ?? "")?.number);
  return (
    <div className="picker">
      <span className="chosen">
        <MarkChip number={number} />
        <select
          data-testid="robot-select"
          aria-label={texts.robot}
          value={selected ?? ""}
          onChange={(event) => onSelect(event.target.value || undefined)}
        >
          <option value="">{texts.chooseARobot}</option>
          {roster.map((robot) => (
            <option key={robot.address} value={robot.address}>
              {label(robot)}
              {robot.address === own && ` · ${texts.yours}`}
            </option>
          ))}
        </select>
      </span>
      {route && (
        <button
          type="button"
          data-testid="route-toggle"
          className={route.tapping ? "on" : ""}
          disabled={!obeys}
          onClick={() => route.onTapping(!route.tapping)}
        >
          {route.tapping ? texts.drive : texts.route}
        </button>
      )}
      <About link={link} selected={selected} />
      {route && isUnderWay ? (
        <button type="button" className="quiet" data-testid="route-clear" disabled={!obeys} onClick={route.onStop}>
          {texts.stopRoute}
        </button>
      ) : (
        selected !== undefined && (
          <button type="button" className="quiet" data-testid="trail-clear" disabled={!obeys} onClick={onClearTrail}>
            {texts.clearTrail}
          </button>
        )
      )}
    </div>
  );
}

function About({ link, selected }: { readonly link: SwarmLink | undefined; readonly selected: string | undefined }) {
  // A string: it re-renders only when the text changes, not with every update.
  const words = useSwarm(link, ({ swarm }) => {
    const robot = selected === undefined ? undefined : swarm.robots.get(selected);
    if (!robot) return texts.tapOne;
    if (robot.shield?.safeMode) return texts.stopped;
    const status = robot.status === ACTIVE ? "" : robot.status === INACTIVE ? texts.notHeard : texts.lost;
    const mode = robot.mode === 1 ? texts.followsItsRoute : "";
    const battery = robot.battery_v ? texts.battery(common.decimal(robot.battery_v, 1)) : "";
    const place = robot.position ? "" : texts.placeUnknown;
    if (robot.walk) return [status, common.phases[robot.walk.phase]].filter(Boolean).join(" · ");
    return [status, place, mode, battery].filter(Boolean).join(" · ") || texts.ready;
  });
  const others = useSwarm(link, (view) => othersWords(view, selected));
  const standing = useStanding(link);
  return (
    <p className="about" data-testid="about">
      {standing !== "" && (
        <strong className="standing" data-testid="standing">
          {standing}{" "}
        </strong>
      )}
      {others !== "" && (
        <strong className="others" data-testid="others">
          {others}
        </strong>
      )}
      {others !== "" ? " · " : ""}
      {/* Always two lines, or the joystick below would move. */}
      {(selected !== undefined || standing === "") && words}
    </p>
  );
}

/** Other drivers of a robot; "" if there are none. Visitors of published pages have no names. */
export function othersWords({ swarm, visit }: SwarmView, address: string | undefined): string {
  const others = driversOf(swarm, address, visit.name);
  const [name = ""] = others;
  if (others.length > 1) return texts.othersDrive(others.length);
  if (others.length === 0) return "";
  return name !== "" ? texts.drivesIt(name) : texts.anotherDrives;
}

/** This visitor's rights and remaining time, which is counted down between updates. */
function useStanding(link: SwarmLink | undefined): string {
  const visit = useSwarm(link, (view) => view.visit);
  const isLimited = (visit.standing?.left_ms ?? 0) > 0;
  const [, setNow] = useState(0);
  useEffect(() => {
    if (!isLimited) return;
    const timer = setInterval(() => setNow(performance.now()), 1000);
    return () => clearInterval(timer);
  }, [isLimited]);
  return useSwarm(link, (view) => standingWords(view.visit, view.swarm, performance.now()));
}
