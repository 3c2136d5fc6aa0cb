// The live map: tap a robot to choose it; in route mode, tap a place to add it. Two fingers, buttons or keys zoom.

import { type KeyboardEvent, type PointerEvent, useEffect, useRef, useState } from "react";
import { type Point, type SwarmSource, useSwarm } from "../client";
import { common as texts } from "../texts";
import { Gesture, type Pinch } from "./gesture";
import { Painter } from "./painter";
import { nearest, rounded, toArea } from "./projection";
import { workWords } from "./work_words";

interface Props {
  readonly link: SwarmSource | undefined;
  readonly selected: string | undefined;
  readonly onSelect?: (address: string) => void;
  readonly routing?: boolean;
  readonly draft?: readonly Point[];
  readonly threshold?: number;
  readonly onWaypoint?: (point: Point) => void;
  /** Whether robots show their marks. */
  readonly marked?: boolean;
  /** Whether a crowded map moves to the chosen robot, and has a button for it. */
  readonly finds?: boolean;
  /** An announcement, read out and shown for a while. */
  readonly news?: string;
}

const TAP_REACH_PX = 28;
/** With this many robots, one is hard to find. */
const CROWD = 13;
const STEP = 1.6;
const PAN_PX = 60;
const NO_POINTS: readonly Point[] = [];
const STILL: Point = { x: 0, y: 0 };

export function MapView({
  link,
  selected,
  onSelect,
  routing = false,
  draft = NO_POINTS,
  threshold = 0,
  onWaypoint,
  marked = true,
  finds = false,
  news = "",
}: Props) {
  const area = useSwarm(link, ({ swarm }) => swarm.area);
  const count = useSwarm(link, ({ swarm }) => swarm.roster.length);
  // A string: it re-renders only when the text changes, not with every update.
  const work = useSwarm(link, ({ swarm }) => (swarm.work ? workWords(swarm.work) : ""));
  const isLive = useSwarm(link, ({ health }) => health.state === "live");
  const [cursor, setCursor] = useState<Point>();
  const [isZoomed, setZoomed] = useState(false);
  const frame = useRef<HTMLDivElement>(null);
  const ground = useRef<HTMLCanvasElement>(null);
  const robots = useRef<HTMLCanvasElement>(null);
  const painter = useRef<Painter>(undefined);
  const gesture = useRef(new Gesture());
  const tapped = useRef<string>(undefined);
  const isFindable = useSwarm(link, ({ swarm }) => finds && swarm.roster.length >= CROWD && swarm.robots.get(selected ?? "")?.position !== undefined);

  useEffect(() => {
    if (!ground.current || !robots.current) return;
    const painting = new Painter(ground.current, robots.current);
    painter.current = painting;
    return () => painting.stop();
  }, []);

  // The canvas is updated without React, ten times a second.
  useEffect(() => {
    if (!link) return;
    const show = () =>
      painter.current?.show({
        swarm: link.view.swarm,
        selected,
        draft,
        threshold,
        cursor: routing ? cursor : undefined,
        marked,
        buttons: 1 + Number(isZoomed) + Number(isFindable),
      });
    show();
    return link.subscribe(show);
  }, [link, selected, draft, threshold, cursor, routing, marked, isZoomed, isFindable]);

  useEffect(() => {
    // A robot chosen on the map is already in sight.
    if (isFindable && selected !== undefined && selected !== tapped.current) setZoomed(painter.current?.find(selected) ?? false);
  }, [isFindable, selected]);

  useEffect(() => {
    const { current: element } = frame;
    // A trackpad's pinch is a wheel event with Control; React's own listener could not prevent zooming the page.
    const onWheel = (event: WheelEvent) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      const box = ground.current?.getBoundingClientRect();
      const around = { x: event.clientX - (box?.left ?? 0), y: event.clientY - (box?.top ?? 0) };
      pinch({ factor: Math.exp(-event.deltaY / 200), around, by: STILL });
    };
    element?.addEventListener("wheel", onWheel, { passive: false });
    return () => element?.removeEventListener("wheel", onWheel);
  }, []);

  function pinch(by?: Pinch) {
    setZoomed(painter.current?.zoom(by) ?? false);
  }

  function find() {
    if (selected !== undefined) setZoomed(painter.current?.find(selected) ?? false);
  }

  function step(factor: number, by: Point = STILL) {
    const middle = painter.current?.middle ?? STILL;
    // The driven robot is moved to the middle and kept in sight.
    const chosen = factor === 1 || selected === undefined ? undefined : painter.current?.places.get(selected);
    pinch(chosen ? { factor, around: chosen, by: { x: middle.x - chosen.x, y: middle.y - chosen.y } } : { factor, around: middle, by });
  }

  function pointOf(event: PointerEvent<HTMLElement>): Point {
    const box = event.currentTarget.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  function onTap(at: Point) {
    const { current: painting } = painter;
    if (!painting?.projection) return;
    if (routing) {
      onWaypoint?.(toArea(painting.projection, at));
      return;
    }
    const address = nearest(painting.places, at, TAP_REACH_PX);
    if (address === undefined) return;
    tapped.current = address;
    onSelect?.(address);
  }

  function onKeyDown(event: KeyboardEvent) {
    const { key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (key === "+" || key === "=") step(STEP);
    else if (key === "-") step(1 / STEP);
    else if (key === "0") pinch();
    else if (routing && (key === "Enter" || key === " ")) onWaypoint?.(rounded(cursor ?? middleOf()));
    else {
      const way = ARROWS[key];
      if (!way || !(routing || isZoomed)) return;
      if (routing) moveCursor(way, event.shiftKey ? 100 : 20);
      else step(1, { x: -way.x * PAN_PX, y: -way.y * PAN_PX });
    }
    event.preventDefault();
  }

  function middleOf(): Point {
    return { x: area.width / 2, y: area.height / 2 };
  }

  function moveCursor(way: Point, parts: number) {
    const at = cursor ?? middleOf();
    const reach = area.width / parts;
    setCursor({
      x: Math.min(Math.max(at.x + way.x * reach, 0), area.width),
      y: Math.min(Math.max(at.y + way.y * reach, 0), area.height),
    });
  }

  const help = routing ? texts.helpToRoute : onSelect ? texts.helpToChoose : texts.helpToZoom;
  const shape = { aspectRatio: String(Math.min(Math.max(area.width / area.height, 0.7), 2)) };
  const invites = routing && draft.length === 0; // the hint does not block taps
  const hint = invites ? texts.tapWhereToGo : !routing && isLive && count === 0 ? texts.noRobotsYet : "";
  return (
    <div className="map" ref={frame} data-routing={routing} data-zoomed={isZoomed} style={shape}>
      <canvas ref={ground} className="map-layer" />
      <canvas ref={robots} className="map-layer" />
      <button
        type="button"
        className="map-touch"
        data-testid="map"
        aria-label={texts.mapWith(texts.robots(count), help)}
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          gesture.current.down(event.pointerId, pointOf(event));
        }}
        onPointerMove={(event) => {
          const moved = gesture.current.move(event.pointerId, pointOf(event));
          if (moved) pinch(moved);
        }}
        onPointerUp={(event) => {
          const tapped = gesture.current.up(event.pointerId);
          if (tapped) onTap(tapped);
        }}
        onPointerCancel={() => gesture.current.cancel()}
        onKeyDown={onKeyDown}
        onBlur={() => setCursor(undefined)}
      />
      {work !== "" && (
        <p className="map-work" data-testid="work">
          {work}
        </p>
      )}
      <p className="map-hint" role="status" data-testid="news">
        {news || hint}
      </p>
      <div className="map-buttons">
        {isFindable && (
          <button type="button" data-testid="find" aria-label={texts.findTheRobot} title={texts.findTheRobot} onClick={find}>
            <svg viewBox="0 0 20 20" width="20" height="20" aria-hidden="true">
              <circle cx="10" cy="10" r="5" />
              <path d="M10 1v5M10 14v5M1 10h5M14 10h5" />
            </svg>
          </button>
        )}
        <button type="button" data-testid="zoom-in" aria-label={texts.zoomIn} onClick={() => step(STEP)}>
          +
        </button>
        {isZoomed && (
          <button type="button" data-testid="zoom-out" aria-label={texts.zoomOut} onClick={() => step(1 / STEP)}>
            −
          </button>
        )}
      </div>
    </div>
  );
}

const ARROWS: Readonly<Record<string, Point>> = {
  ArrowLeft: { x: -1, y: 0 },
  ArrowRight: { x: 1, y: 0 },
  ArrowUp: { x: 0, y: -1 },
  ArrowDown: { x: 0, y: 1 },
};
