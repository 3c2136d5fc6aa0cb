// A route: tapped on the map, then sent in one command. It replaces the joystick, so that a phone shows it together
// with the map.

import { type Point, type SwarmLink, useSwarm } from "../client";
import { visitor as texts } from "../texts";

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
  const points = texts.points(draft.length);
  return (
    <fieldset className="panel route" disabled={disabled}>
      <legend>{texts.routeOf(draft.length >= most ? texts.theMost(points) : draft.length > 0 ? points : texts.tapOnTheMap)}</legend>
      <div className="buttons">
        <button
          type="button"
          data-testid="route-start"
          className="primary"
          aria-label={texts.startTheRoute(points)}
          disabled={draft.length === 0}
          onClick={onStart}
        >
          {texts.start}
        </button>
        <button type="button" data-testid="route-undo" disabled={draft.length === 0} onClick={onUndo}>
          {texts.undo}
        </button>
      </div>
      <label className="slider">
        <span>{texts.closeEnough}</span>
        <input
          type="range"
          data-testid="threshold"
          aria-label={texts.howClose}
          min="10"
          max="500"
          step="10"
          value={threshold}
          aria-valuetext={texts.millimetres(threshold)}
          onChange={(event) => onThreshold(Number(event.target.value))}
        />
        <output>{texts.millimetres(threshold)}</output>
      </label>
    </fieldset>
  );
}
