// A route: tapped on the map, then sent in one command. It stands where the joystick stands, so that a phone shows it
// together with the map.

import { type Point, type SwarmLink, useSwarm } from "../client";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly disabled: boolean;
  readonly draft: readonly Point[];
  readonly onUndo: () => void;
  readonly threshold: number;
  readonly onThreshold: (threshold: number) => void;
  readonly onStart: () => void;
}

/** The payload of `waypoints`. PyDotBot refuses points without z. */
export function routePayload(threshold: number, points: readonly Point[]) {
  return { threshold, waypoints: points.map(({ x, y }) => ({ x, y, z: 0 })) };
}

export function Route({ link, disabled, draft, onUndo, threshold, onThreshold, onStart }: Props) {
  const most = useSwarm(link, ({ swarm }) => swarm.mostWaypoints);
  const points = draft.length === 1 ? "1 waypoint" : `${draft.length} waypoints`;
  return (
    <fieldset className="panel route" disabled={disabled}>
      <legend>Route: {draft.length >= most ? `${points}, the most` : draft.length > 0 ? points : "tap on the map"}</legend>
      <div className="buttons">
        <button
          type="button"
          data-testid="route-start"
          className="primary"
          aria-label={`Start the route: ${points}`}
          disabled={draft.length === 0}
          onClick={onStart}
        >
          Start
        </button>
        <button type="button" data-testid="route-undo" disabled={draft.length === 0} onClick={onUndo}>
          Undo
        </button>
      </div>
      <label className="slider">
        <span>Reach within</span>
        <input
          type="range"
          data-testid="threshold"
          aria-label="Threshold: how near to a waypoint is near enough"
          min="10"
          max="500"
          step="10"
          value={threshold}
          aria-valuetext={`${threshold} mm`}
          onChange={(event) => onThreshold(Number(event.target.value))}
        />
        <output>
          {threshold} mm
        </output>
      </label>
    </fieldset>
  );
}
