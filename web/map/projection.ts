// Convert between the area's lengths and the canvas's pixels (CSS pixels, origin top left, y down in both).

import type { Area, Point } from "../client";
import type { Pinch } from "./gesture";

export interface Projection {
  readonly area: Area;
  /** Pixels per unit of length. */
  readonly scale: number;
  readonly left: number;
  readonly top: number;
}

/** Space around the area for robots on its edge. */
const MARGIN = 12;

/** The visible part of the area: scaled by a factor, with this place in the middle. */
export interface Zoom {
  readonly times: number;
  readonly at: Point;
}

const MOST_TIMES = 12;

/** Fit the area into a canvas, or zoom it, with as little empty space as possible. */
export function fitArea(area: Area, width: number, height: number, zoom?: Zoom): Projection {
  const fit = Math.max(Math.min((width - 2 * MARGIN) / area.width, (height - 2 * MARGIN) / area.height), 1e-9);
  const scale = fit * (zoom?.times ?? 1);
  const start = (room: number, length: number, at: number | undefined) => {
    const most = Math.max(MARGIN, (room - length) / 2);
    return Math.min(Math.max(room / 2 - (at ?? length / 2), Math.min(room - MARGIN - length, most)), most);
  };
  return {
    area,
    scale,
    left: start(width, area.width * scale, zoom && zoom.at.x * scale),
    top: start(height, area.height * scale, zoom && zoom.at.y * scale),
  };
}

/** The zoom after a gesture on the projection `p`; undefined if the whole area is visible. */
export function zoomed(p: Projection, width: number, height: number, { factor, around, by }: Pinch): Zoom | undefined {
  const whole = fitArea(p.area, width, height).scale;
  const times = Math.min((p.scale / whole) * factor, MOST_TIMES);
  if (times <= 1) return undefined;
  const scale = times * whole;
  // The place under the fingers stays there.
  const middle = (room: number, start: number, place: number, moved: number) =>
    (place - start) / p.scale + (room / 2 - place - moved) / scale;
  return {
    times,
    at: { x: middle(width, p.left, around.x, by.x), y: middle(height, p.top, around.y, by.y) },
  };
}

export function toScreen({ scale, left, top }: Projection, { x, y }: Point): Point {
  return { x: left + x * scale, y: top + y * scale };
}

/** A place within the area: a tap on the margin counts as its edge. */
export function toArea({ area, scale, left, top }: Projection, { x, y }: Point): Point {
  const clamp = (value: number, most: number) => Math.min(Math.max(value, 0), most);
  return rounded({ x: clamp((x - left) / scale, area.width), y: clamp((y - top) / scale, area.height) });
}

/** As it is sent: whole millimetres. */
export function rounded({ x, y }: Point): Point {
  return { x: Math.round(x), y: Math.round(y) };
}

/** Distance between grid lines: 1, 2 or 5 times a power of ten, about a fifth of the area. */
export function gridStep(area: Area): number {
  const rough = Math.max(area.width, area.height) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const digit = rough / power;
  return (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10) * power;
}

/** The place nearest to `at`, within `reach` pixels. */
export function nearest(places: ReadonlyMap<string, Point>, at: Point, reach: number): string | undefined {
  let best: string | undefined;
  let bestDistance = reach;
  for (const [address, { x, y }] of places) {
    const distance = Math.hypot(x - at.x, y - at.y);
    if (distance <= bestDistance) {
      best = address;
      bestDistance = distance;
    }
  }
  return best;
}
