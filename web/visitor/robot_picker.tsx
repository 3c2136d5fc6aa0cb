// Choosing a robot from the list, one line about it, and what can be done to it besides driving.

import { ACTIVE, driversOf, INACTIVE, label, type SwarmLink, useSwarm } from "../client";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly onSelect: (address: string | undefined) => void;
  /** Whether the robot obeys now. */
  readonly obeys: boolean;
  readonly onClearTrail: () => void;
  /** Undefined where robots take no routes. */
  readonly route: { readonly tapping: boolean; readonly onTapping: (on: boolean) => void; readonly onStop: () => void } | undefined;
}

export function RobotPicker({ link, selected, onSelect, obeys, onClearTrail, route }: Props) {
  const roster = useSwarm(link, ({ swarm }) => swarm.roster);
  const isUnderWay = useSwarm(link, ({ swarm }) => (swarm.robots.get(selected ?? "")?.waypoints.length ?? 0) > 0);
  return (
    <div className="picker">
      <select
        data-testid="robot-select"
        aria-label="Robot"
        value={selected ?? ""}
        onChange={(event) => onSelect(event.target.value || undefined)}
      >
        <option value="">Choose a robot…</option>
        {roster.map((robot) => (
          <option key={robot.address} value={robot.address}>
            {label(robot)}
          </option>
        ))}
      </select>
      {route && (
        <button
          type="button"
          data-testid="route-toggle"
          className={route.tapping ? "on" : ""}
          disabled={!obeys}
          onClick={() => route.onTapping(!route.tapping)}
        >
          {route.tapping ? "Drive" : "Route"}
        </button>
      )}
      <About link={link} selected={selected} />
      {route && isUnderWay ? (
        <button type="button" className="quiet" data-testid="route-clear" disabled={!obeys} onClick={route.onStop}>
          Stop route
        </button>
      ) : (
        selected !== undefined && (
          <button type="button" className="quiet" data-testid="trail-clear" disabled={!obeys} onClick={onClearTrail}>
            Clear trail
          </button>
        )
      )}
    </div>
  );
}

function About({ link, selected }: { readonly link: SwarmLink | undefined; readonly selected: string | undefined }) {
  // A string: it renders again only when the words change, not at every frame.
  const words = useSwarm(link, ({ swarm }) => {
    const robot = selected === undefined ? undefined : swarm.robots.get(selected);
    if (!robot) return "Tap one on the map, or choose it here.";
    if (robot.shield?.safeMode) return "stopped";
    const status = robot.status === ACTIVE ? "" : robot.status === INACTIVE ? "not heard for a while" : "lost";
    const mode = robot.mode === 1 ? "following its route" : "";
    const battery = robot.battery_v ? `battery ${robot.battery_v.toFixed(1)} V` : "";
    const place = robot.position ? "" : "position unknown";
    if (robot.walk) return [status, robot.walk.phase].filter(Boolean).join(" · ");
    return [status, place, mode, battery].filter(Boolean).join(" · ") || "ready";
  });
  const others = useSwarm(link, ({ swarm }) => driversOf(swarm, selected, link?.name ?? ""));
  return (
    <p className="about" data-testid="about">
      {others > 0 && (
        <strong className="others" data-testid="others">
          {others === 1 ? "Another visitor drives it" : `${others} other visitors drive it`}
        </strong>
      )}
      {others > 0 ? " · " : ""}
      {words}
    </p>
  );
}
