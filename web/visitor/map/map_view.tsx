// The live map: tap a robot to choose it; in route mode, tap a place to go there.

import { type KeyboardEvent, type PointerEvent, useEffect, useRef, useState } from "react";
import { type Point, type SwarmLink, useSwarm } from "../../client";
import { Painter } from "./painter";
import { nearest, rounded, toArea } from "./projection";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly onSelect: (address: string) => void;
  readonly routing: boolean;
  readonly draft: readonly Point[];
  readonly threshold: number;
  readonly onWaypoint: (point: Point) => void;
}

const TAP_REACH_PX = 28;
/** A finger that moved further was scrolling. */
const TAP_SLIP_PX = 12;

export function MapView({ link, selected, onSelect, routing, draft, threshold, onWaypoint }: Props) {
  const area = useSwarm(link, ({ swarm }) => swarm.area);
  const count = useSwarm(link, ({ swarm }) => swarm.roster.length);
  const isLive = useSwarm(link, ({ health }) => health.state === "live");
  const [cursor, setCursor] = useState<Point>();
  const ground = useRef<HTMLCanvasElement>(null);
  const robots = useRef<HTMLCanvasElement>(null);
  const painter = useRef<Painter>(undefined);
  const pressed = useRef<Point>(undefined);

  useEffect(() => {
    if (!ground.current || !robots.current) return;
    const painting = new Painter(ground.current, robots.current);
    painter.current = painting;
    return () => painting.stop();
  }, []);

  // The swarm goes to the canvas past React: ten frames a second need no reconciling.
  useEffect(() => {
    if (!link) return;
    const show = () =>
      painter.current?.show({
        swarm: link.view.swarm,
        selected,
        draft,
        threshold,
        cursor: routing ? cursor : undefined,
      });
    show();
    return link.subscribe(show);
  }, [link, selected, draft, threshold, cursor, routing]);

  function pointOf(event: PointerEvent<HTMLElement>): Point {
    const box = event.currentTarget.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  function onPointerUp(event: PointerEvent<HTMLElement>) {
    const from = pressed.current;
    pressed.current = undefined;
    const at = pointOf(event);
    const { current: painting } = painter;
    if (!from || !painting?.projection || Math.hypot(at.x - from.x, at.y - from.y) > TAP_SLIP_PX) return;
    if (routing) {
      onWaypoint(toArea(painting.projection, at));
      return;
    }
    const address = nearest(painting.places, at, TAP_REACH_PX);
    if (address !== undefined) onSelect(address);
  }

  function onKeyDown(event: KeyboardEvent) {
    if (!routing) return;
    const at = cursor ?? { x: area.width / 2, y: area.height / 2 };
    if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      onWaypoint(rounded(area, at));
      return;
    }
    const step = area.width / (event.shiftKey ? 100 : 20);
    const moves: Readonly<Record<string, Point>> = {
      ArrowLeft: { x: -step, y: 0 },
      ArrowRight: { x: step, y: 0 },
      ArrowUp: { x: 0, y: -step },
      ArrowDown: { x: 0, y: step },
    };
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    setCursor({
      x: Math.min(Math.max(at.x + move.x, 0), area.width),
      y: Math.min(Math.max(at.y + move.y, 0), area.height),
    });
  }

  const robotsWord = count === 1 ? "1 robot" : `${count} robots`;
  const help = routing ? "Tap, or use the arrow keys and Enter, to add a waypoint." : "Tap a robot to choose it.";
  const shape = { aspectRatio: String(Math.min(Math.max(area.width / area.height, 0.7), 2)) };
  return (
    <div className="map" data-routing={routing} style={shape}>
      <canvas ref={ground} className="map-layer" />
      <canvas ref={robots} className="map-layer" />
      <button
        type="button"
        className="map-touch"
        data-testid="map"
        aria-label={`Map with ${robotsWord}. ${help}`}
        onPointerDown={(event) => {
          pressed.current = pointOf(event);
        }}
        onPointerUp={onPointerUp}
        onPointerCancel={() => {
          pressed.current = undefined;
        }}
        onKeyDown={onKeyDown}
        onBlur={() => setCursor(undefined)}
      />
      {routing && <p className="map-hint">Tap where the robot shall go</p>}
      {!routing && isLive && count === 0 && <p className="map-hint">No robots yet</p>}
    </div>
  );
}
