// Shields on the map. A robot's ring has one arc for each needed token, which shrinks as the token ages. A robot in
// Safe Mode is grey with a cross and a broken ring. An audit is a line from auditor to auditee that fades.

import { type Audit, counting, LOW_MS, type Point, type Robot, type ShieldTerms } from "../client";
import type { Theme } from "./theme";

const TURN = 2 * Math.PI;
const TOP = -TURN / 4;
/** Gap between two arcs, radians. */
const GAP = 0.22;
const PASSED_FOR_MS = 500;
/** Longer than passed audits: refusals are rare and important. */
export const REFUSED_FOR_MS = 1600;
/** With this many lines at a time, those of passed audits are thin. */
const MANY_LINES = 12;

/** Distance of a ring from a disc's edge, and its width; names and marks leave this space. */
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
    // Sorted by number: an arc keeps its position when its token is renewed.
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

/** A broken ring: three displaced pieces. */
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

/** Whether lines are still visible. */
export function areFlashing(audits: readonly Audit[], now_ms: number): boolean {
  return audits.some((audit) => ageOf(audit, now_ms) < 1);
}

/** Lines of recent audits. `still`: they disappear without fading. */
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

/** A cross over a disc. Not by colour alone: grey looks like some LEDs, on projectors and to some eyes. */
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

/** Not by colour alone either: a refusal has a cross at the auditee. */
function addCross(ctx: CanvasRenderingContext2D, { x, y }: Point, reach: number): void {
  ctx.moveTo(x - reach, y - reach);
  ctx.lineTo(x + reach, y + reach);
  ctx.moveTo(x - reach, y + reach);
  ctx.lineTo(x + reach, y - reach);
}

/** A point between `from` and `to`, `before` pixels before the end. */
function between(from: Point, to: Point, before: number): Point {
  const distance = Math.hypot(to.x - from.x, to.y - from.y);
  const share = distance > before ? 1 - before / distance : 1;
  return { x: from.x + (to.x - from.x) * share, y: from.y + (to.y - from.y) * share };
}

/** 0: just ended, 1: no longer shown. */
function ageOf({ at_ms, refusal }: Audit, now_ms: number): number {
  return Math.max(0, (now_ms - at_ms) / (refusal === "" ? PASSED_FOR_MS : REFUSED_FOR_MS));
}
