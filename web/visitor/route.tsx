// A route: tapped on the map, then sent in one command.

import { type Point, type SwarmLink, useSwarm } from "../client";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly routing: boolean;
  readonly onRouting: (on: boolean) => void;
  readonly draft: readonly Point[];
  readonly onUndo: () => void;
  readonly threshold: number;
  readonly onThreshold: (threshold: number) => void;
  readonly onStart: () => void;
  readonly onClear: () => void;
}

/** The payload of `waypoints`. PyDotBot refuses points without z. */
export function routePayload(threshold: number, points: readonly Point[]) {
  return { threshold, waypoints: points.map(({ x, y }) => ({ x, y, z: 0 })) };
}

export function Route(props: Props) {
  const { link, selected, routing, draft, threshold } = props;
  const unit = useSwarm(link, ({ swarm }) => (swarm.area.unit === "mm" ? "mm" : "‰ of the side"));
  const most = useSwarm(link, ({ swarm }) => swarm.mostWaypoints);
  const disabled = selected === undefined;
  const points = draft.length === 1 ? "1 waypoint" : `${draft.length} waypoints`;
  return (
    <fieldset className="panel route" disabled={disabled}>
      <legend>Route</legend>
      <div className="buttons">
        <button
          type="button"
          data-testid="route-toggle"
          className={routing ? "on" : ""}
          aria-pressed={routing}
          onClick={() => props.onRouting(!routing)}
        >
          {routing ? "Done tapping" : "Tap a route"}
        </button>
        <button type="button" data-testid="route-undo" disabled={draft.length === 0} onClick={props.onUndo}>
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
          aria-valuetext={`${threshold} ${unit}`}
          onChange={(event) => props.onThreshold(Number(event.target.value))}
        />
        <output>
          {threshold} {unit}
        </output>
      </label>
      <div className="buttons">
        <button
          type="button"
          data-testid="route-start"
          className="primary"
          aria-label={`Start the route: ${points}`}
          disabled={draft.length === 0}
          onClick={props.onStart}
        >
          Start{draft.length > 0 && ` (${draft.length}${draft.length >= most ? ", the most" : ""})`}
        </button>
        <button type="button" data-testid="route-clear" onClick={props.onClear}>
          Clear
        </button>
      </div>
    </fieldset>
  );
}
