// Choosing a robot from the list, and one line about it.

import { ACTIVE, INACTIVE, label, type SwarmLink, useSwarm } from "../client";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly onSelect: (address: string | undefined) => void;
  readonly onClearTrail: () => void;
}

export function RobotPicker({ link, selected, onSelect, onClearTrail }: Props) {
  const roster = useSwarm(link, ({ swarm }) => swarm.roster);
  return (
    <div className="picker">
      <label htmlFor="robot-select">Robot</label>
      <select
        id="robot-select"
        data-testid="robot-select"
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
      <About link={link} selected={selected} />
      {selected !== undefined && (
        <button type="button" className="quiet" data-testid="trail-clear" onClick={onClearTrail}>
          Clear trail
        </button>
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
  return <p className="about">{words}</p>;
}
