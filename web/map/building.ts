// The building of a mission: its walls, and the decoded landmarks. Landmarks that are still encoded are not shown, as this
// page does not know their places.

import type { Missions, Wall } from "../client";
import { circle } from "./circle";
import { type Projection, toScreen } from "./projection";
import type { Theme } from "./theme";

const TURN = 2 * Math.PI;
const LAMP_PX = 5;
const GLOW_PX = 13;
/** With more lamps or walls than this, they are drawn smaller. */
const MANY_LAMPS = 60;
const MANY_WALLS = 200;

/** The walls' path, cached until the map's size changes: building it for thousands of walls takes longer than a frame. */
let known: { readonly walls: readonly Wall[]; readonly p: Projection; readonly path: Path2D } | undefined;

export function drawWalls(ctx: CanvasRenderingContext2D, p: Projection, theme: Theme, walls: readonly Wall[]): void {
  const same = known?.walls === walls && known.p.scale === p.scale && known.p.left === p.left && known.p.top === p.top;
  if (!known || !same) known = { walls, p, path: pathOf(p, walls) };
  ctx.strokeStyle = theme.wall;
  ctx.lineWidth = walls.length > MANY_WALLS ? 1.5 : 2.5;
  ctx.lineCap = "round";
  ctx.stroke(known.path);
  ctx.lineCap = "butt";
}

function pathOf(p: Projection, walls: readonly Wall[]): Path2D {
  const path = new Path2D();
  for (const [ax, ay, bx, by] of walls) {
    const [a, b] = [toScreen(p, { x: ax, y: ay }), toScreen(p, { x: bx, y: by })];
    path.moveTo(a.x, a.y);
    path.lineTo(b.x, b.y);
  }
  return path;
}

/** Not by colour alone: a lamp has a ring and rays. */
export function drawLit(ctx: CanvasRenderingContext2D, p: Projection, theme: Theme, missions: Missions): void {
  const { lit, progress } = missions;
  const size = (progress?.nodes ?? 0) > MANY_LAMPS ? 0.6 : 1;
  ctx.fillStyle = theme.lit;
  ctx.strokeStyle = theme.lit;
  ctx.lineWidth = 2 * size;
  for (const one of lit) {
    const { x, y } = toScreen(p, one);
    ctx.globalAlpha = 0.28;
    disc(ctx, x, y, GLOW_PX * size);
    ctx.globalAlpha = 1;
    disc(ctx, x, y, LAMP_PX * size);
    ctx.beginPath();
    for (let k = 0; k < 8; k += 1) {
      const [dx, dy] = [Math.cos((k * TURN) / 8), Math.sin((k * TURN) / 8)];
      ctx.moveTo(x + dx * (LAMP_PX + 2.5) * size, y + dy * (LAMP_PX + 2.5) * size);
      ctx.lineTo(x + dx * (LAMP_PX + 6) * size, y + dy * (LAMP_PX + 6) * size);
    }
    ctx.stroke();
  }
}

function disc(ctx: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  circle(ctx, x, y, radius);
  ctx.fill();
}
