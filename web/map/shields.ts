// Shields on the map. A robot's ring has one arc for each token that it needs; each drains as its token ages. A robot in
// Safe Mode is grey with a cross, its ring in pieces. An audit is a line from auditor to auditee that fades.

import { type Audit, counting, LOW_MS, type Point, type Robot, type ShieldTerms } from "../client";
import type { Theme } from "./theme";

const TURN = 2 * Math.PI;
const TOP = -TURN / 4;
/** Between two arcs, radians. */
const GAP = 0.22;
const PASSED_FOR_MS = 500;
/** Longer: it is rare, and what people should see. */
export const REFUSED_FOR_MS = 1600;
/** From so many lines at a time on, those that say that all is well are thin. */
const MANY_LINES = 12;

/** How far a ring's middle is from a disc's edge, and how thick it is; so much room names and marks leave. */
export const RING_OFF_PX = 4;
const RING_PX = 3;

/** All rings, in four strokes whatever the number of robots. */
export function drawShields(
  ctx: CanvasRenderingContext2D,
  theme: Theme,
  terms: ShieldTerms,
  robots: readonly Robot[],
  places: ReadonlyMap<string, Point>,
  radius: number,
  now_ms: number,
): void {
  const ring = radius + RING_OFF_PX;
  const share = TURN / terms.needed;
  const [tracks, fresh, low, broken] = [new Path2D(), new Path2D(), new Path2D(), new Path2D()];
  for (const { address, shield } of robots) {
    const place = places.get(address);
    if (!shield || !place) continue;
    if (shield.safeMode) {
      addPieces(broken, place, ring);
      continue;
    }
    // By number: an arc keeps its place when its token is renewed.
    const vouchers = [...counting(shield, terms, now_ms)].sort((a, b) => a.auditor - b.auditor);
    for (let k = 0; k < terms.needed; k += 1) {
      const from = TOP + k * share + GAP / 2;
      addArc(tracks, place, ring, from, from + share - GAP);
      const voucher = vouchers[k];
      if (!voucher) continue;
      const left_ms = voucher.until_ms - now_ms;
      const left = Math.min(left_ms / terms.full_ms, 1);
      addArc(left_ms < LOW_MS ? low : fresh, place, ring, from, from + left * (share - GAP));
    }
  }
  ctx.lineWidth = RING_PX;
  ctx.lineCap = "butt";
  for (const [path, colour, alpha] of [
    [tracks, theme.edge, 0.7],
    [fresh, theme.good, 1],
    [low, theme.warn, 1],
    [broken, theme.muted, 1],
  ] as const) {
    ctx.globalAlpha = alpha;
    ctx.strokeStyle = colour;
    ctx.stroke(path);
  }
  ctx.globalAlpha = 1;
}

function addArc(path: Path2D, { x, y }: Point, radius: number, from: number, to: number): void {
  path.moveTo(x + radius * Math.cos(from), y + radius * Math.sin(from));
  path.arc(x, y, radius, from, to);
}

/** Three pieces, each fallen a little way off its place. */
function addPieces(path: Path2D, { x, y }: Point, radius: number): void {
  for (const [middle, half, off] of [
    [-2.2, 0.5, 2.5],
    [-0.1, 0.35, 4],
    [1.9, 0.55, 3],
  ] as const) {
    const from = { x: x + off * Math.cos(middle), y: y + off * Math.sin(middle) };
    addArc(path, from, radius, middle - half, middle + half);
  }
}

/** Whether lines are still to be seen. */
export function areFlashing(audits: readonly Audit[], now_ms: number): boolean {
  return audits.some((audit) => ageOf(audit, now_ms) < 1);
}

/** Lines of audits that ended lately. `still`: they do not fade, they end. */
export function drawAudits(
  ctx: CanvasRenderingContext2D,
  theme: Theme,
  audits: readonly Audit[],
  places: ReadonlyMap<string, Point>,
  radius: number,
  now_ms: number,
  still: boolean,
): void {
  const shown = audits.filter((audit) => ageOf(audit, now_ms) < 1);
  for (const audit of shown) {
    const [from, to] = [places.get(audit.auditor), places.get(audit.auditee)];
    if (!from || !to) continue;
    const refused = audit.refusal !== "";
    const strength = still ? 1 : 1 - ageOf(audit, now_ms);
    ctx.globalAlpha = refused ? 0.25 + 0.75 * strength : 0.7 * strength;
    ctx.strokeStyle = refused ? theme.bad : theme.good;
    ctx.lineWidth = refused ? 3 : shown.length > MANY_LINES ? 1 : 2;
    ctx.beginPath();
    ctx.moveTo(from.x, from.y);
    ctx.lineTo(to.x, to.y);
    ctx.stroke();
    if (!refused) continue;
    ctx.beginPath();
    addCross(ctx, between(from, to, radius + 2.5 * RING_OFF_PX), 5);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

/** Over discs. Not by colour alone: on a projector grey is light blue, and to some eyes many LEDs are grey. */
export function crossOut(
  ctx: CanvasRenderingContext2D,
  theme: Theme,
  stopped: readonly Robot[],
  places: ReadonlyMap<string, Point>,
  radius: number,
): void {
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = Math.max(2, radius / 4);
  ctx.beginPath();
  for (const { address } of stopped) {
    const place = places.get(address);
    if (place) addCross(ctx, place, 0.6 * radius);
  }
  ctx.stroke();
}

/** Not by colour alone either: a refusal has a cross where it meets the robot. */
function addCross(ctx: CanvasRenderingContext2D, { x, y }: Point, reach: number): void {
  ctx.moveTo(x - reach, y - reach);
  ctx.lineTo(x + reach, y + reach);
  ctx.moveTo(x - reach, y + reach);
  ctx.lineTo(x + reach, y - reach);
}

/** On the way from `from` to `to`, so many pixels before its end. */
function between(from: Point, to: Point, before: number): Point {
  const distance = Math.hypot(to.x - from.x, to.y - from.y);
  const share = distance > before ? 1 - before / distance : 1;
  return { x: from.x + (to.x - from.x) * share, y: from.y + (to.y - from.y) * share };
}

/** 0 just ended, 1 no longer shown. */
function ageOf({ at_ms, refusal }: Audit, now_ms: number): number {
  return Math.max(0, (now_ms - at_ms) / (refusal === "" ? PASSED_FOR_MS : REFUSED_FOR_MS));
}
