// Names on the map: as many as fit without overlapping each other or a robot.

import { nameWithDriver, type Point, type Robot } from "../client";
import type { Projection } from "./projection";
import type { Theme } from "./theme";

/** Font size in pixels: large maps are read from a distance. */
const LEAST_SIZE = 12;
const MOST_SIZE = 18;
const LINES = 45;
/** Gap on each side, so that two names do not look like one. */
const APART = 3;
/** With more robots in sight, names do not fit. */
const MOST_IN_SIGHT = 250;
const MOST_WIDTHS = 4000;
/** Size of a button in the lower right corner, as in map.css. */
const BUTTON = 44;

interface Box {
  readonly left: number;
  readonly top: number;
  readonly right: number;
  readonly bottom: number;
}

const widths = new Map<string, number>();

export class Names {
  /** Robots named last time: they keep their names if possible, so that names do not flicker as robots pass. */
  #named: ReadonlySet<string> = new Set();

  /** `rim`: radius of a robot with its rings; `selected` is always named. */
  draw(
    ctx: CanvasRenderingContext2D,
    p: Projection,
    theme: Theme,
    robots: readonly Robot[],
    places: ReadonlyMap<string, Point>,
    rim: number,
    selected: string | undefined,
    room: { readonly width: number; readonly height: number; readonly buttons: number },
  ): void {
    const size = Math.round(Math.min(Math.max(room.height / LINES, LEAST_SIZE), MOST_SIZE));
    const line = size + 3;
    const inSight = robots.flatMap((robot) => {
      const at = places.get(robot.address);
      return at && at.x > 0 && at.y > 0 && at.x < room.width && at.y < room.height ? [{ robot, at }] : [];
    });
    const crowded = inSight.length > MOST_IN_SIGHT;
    const { width, height } = room;
    const buttons = { left: width - BUTTON, top: height - room.buttons * BUTTON, right: width, bottom: height };
    const taken = crowded ? [] : [buttons, ...inSight.map(({ at }) => around(at, rim))];
    const rank = ({ address }: Robot) => (address === selected ? 0 : this.#named.has(address) ? 1 : 2);
    const named = new Set<string>();
    const bottom = Math.min(p.top + p.area.height * p.scale, room.height) + 6;
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    ctx.lineJoin = "round";
    ctx.lineWidth = 3;
    ctx.strokeStyle = theme.halo;
    ctx.fillStyle = theme.ink;
    for (const { robot, at } of inSight.sort((a, b) => rank(a.robot) - rank(b.robot))) {
      const chosen = robot.address === selected;
      if (crowded && !chosen) break;
      const name = nameWithDriver(robot);
      ctx.font = `${chosen ? 700 : 500} ${size}px system-ui, sans-serif`;
      const half = widthOf(ctx, name) / 2 + APART;
      const reach = chosen ? rim + 6 : rim;
      const x = Math.min(Math.max(at.x, half + 2), room.width - half - 2);
      // Below the robot, or above it if there is no space below.
      const boxes = [at.y + reach + 2, at.y - reach - 2 - line]
        .filter((top) => top >= 0 && top + line <= bottom)
        .map((top) => ({ left: x - half, top, right: x + half, bottom: top + line }));
      const box = boxes.find((each) => !taken.some((other) => overlap(each, other))) ?? (chosen ? boxes[0] : undefined);
      if (!box) continue;
      taken.push(box);
      named.add(robot.address);
      ctx.strokeText(name, x, box.top + 1);
      ctx.fillText(name, x, box.top + 1);
    }
    this.#named = named;
  }
}

function around({ x, y }: Point, reach: number): Box {
  return { left: x - reach, top: y - reach, right: x + reach, bottom: y + reach };
}

function overlap(a: Box, b: Box): boolean {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

function widthOf(ctx: CanvasRenderingContext2D, name: string): number {
  const key = `${ctx.font} ${name}`;
  const known = widths.get(key);
  if (known !== undefined) return known;
  if (widths.size >= MOST_WIDTHS) widths.clear();
  const { width } = ctx.measureText(name);
  widths.set(key, width);
  return width;
}
