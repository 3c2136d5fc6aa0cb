// A run as the gateway encodes it (src/phalanx/world/scenarios/scenes.py), and the swarm to draw at one moment of it.

import {
  ACTIVE,
  type Area,
  type Audit,
  type Missions,
  NO_SWARM,
  type Point,
  type Rgb,
  type Robot,
  type Shield,
  type Swarm,
  Trail,
  type Wall,
} from "../client";
import { REFUSED_FOR_MS } from "../map/shields";
import { viewer as texts } from "../texts";

/** An event of a robot, as text. */
type Event = readonly [t_s: number, robot: number, words: string];
type Verdict = readonly [t_s: number, auditor: number, auditee: number, refusal: string];

/** Millimetres and degrees, x to the right and y upwards; seconds. */
export interface Step {
  readonly t: number;
  readonly at: readonly (readonly [robot: number, x: number, y: number, heading: number])[];
  readonly lies: readonly (readonly [robot: number, attack: string])[];
  readonly shields?: readonly (readonly [robot: number, safe: boolean, tokens: readonly (readonly [number, number])[]])[];
  readonly audits?: readonly Verdict[];
  readonly events?: readonly Event[];
  readonly marks?: readonly (readonly [x: number, y: number])[];
  readonly walls?: readonly Wall[];
}

export type Line = Step | { readonly about: Readonly<Record<string, string>> } | { readonly end: true };

const HONEST: Rgb = { red: 0, green: 114, blue: 178 };
const LIAR: Rgb = { red: 213, green: 94, blue: 0 };
const TRAIL_STEPS = 60;
const MOST_WITH_TRAILS = 200;
/** Steps further apart than this are not interpolated. */
const GLIDE_S = 1;
const MOST_AUDITS = 256;
/** Marks and walls to draw at most: all are drawn many times a second. */
const MOST_DRAWN = 10_000;
const MARGIN = 0.06;
const LEAST_MM = 1000;

/** The part of a run received so far. */
export class Run {
  about: Readonly<Record<string, string>> = {};
  ended = false;
  readonly steps: Step[] = [];
  /** Refusals and other events to list, in order. */
  readonly events: Event[] = [];
  #box = { left: Infinity, right: -Infinity, bottom: Infinity, top: -Infinity };
  #area: Area = NO_SWARM.area;
  readonly #walls: Wall[] = [];
  #drawn: readonly Wall[] = [];
  readonly #marks: (Point & { readonly t: number; readonly type: string })[] = [];

  add(lines: readonly Line[]): void {
    const before = { ...this.#box };
    const walls = this.#walls.length;
    for (const line of lines) {
      if ("about" in line) this.about = line.about;
      else if ("end" in line) this.ended = true;
      else this.#step(line);
    }
    const { left, right, bottom, top } = this.#box;
    const moved = before.left !== left || before.right !== right || before.bottom !== bottom || before.top !== top;
    if (!moved && walls === this.#walls.length) return;
    const margin = Math.max(MARGIN * Math.max(right - left, top - bottom), LEAST_MM);
    this.#area = { width: right - left + 2 * margin, height: top - bottom + 2 * margin };
    this.#drawn = this.#walls.map(([ax, ay, bx, by]) => {
      const [a, b] = [this.#shown(ax, ay), this.#shown(bx, by)];
      return [a.x, a.y, b.x, b.y];
    });
  }

  get end_s(): number {
    return this.steps.at(-1)?.t ?? 0;
  }

  #step(step: Step): void {
    this.steps.push(step);
    const places = [...step.at.map(([, x, y]) => [x, y] as const), ...(step.marks ?? [])];
    const ends = (step.walls ?? []).flatMap(([ax, ay, bx, by]) => [[ax, ay] as const, [bx, by] as const]);
    for (const [x, y] of [...places, ...ends]) this.#stretch(x, y);
    // One by one: spread arguments have to fit the stack.
    for (const [x, y] of step.marks ?? []) if (this.#marks.length < MOST_DRAWN) this.#marks.push({ t: step.t, x, y, type: "" });
    for (const wall of step.walls ?? []) if (this.#walls.length < MOST_DRAWN) this.#walls.push(wall);
    const refused = (step.audits ?? []).filter(([, , , refusal]) => refusal !== "");
    const told = refused.map(([t, by, of, refusal]): Event => [t, of, texts.refusedAToken(by, refusal)]);
    for (const event of [...told, ...(step.events ?? [])].sort((a, b) => a[0] - b[0])) this.events.push(event);
  }

  #stretch(x: number, y: number): void {
    const { left, right, bottom, top } = this.#box;
    if (x >= left && x <= right && y >= bottom && y <= top) return;
    this.#box = { left: Math.min(left, x), right: Math.max(right, x), bottom: Math.min(bottom, y), top: Math.max(top, y) };
  }

  /** A place on the map, whose y points down. */
  #shown(x: number, y: number): Point {
    const { left, right, bottom } = this.#box;
    const margin = (this.#area.width - (right - left)) / 2;
    return { x: x - left + margin, y: this.#area.height - (y - bottom) - margin };
  }

  /** Index of the newest step at a moment; -1 before the first. */
  indexAt(t_s: number): number {
    let [low, high] = [0, this.steps.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.steps[middle]?.t ?? 0) <= t_s) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  /** The swarm at a moment of the run, played at `speed`, by a clock that shows `now_ms`. */
  swarmAt(t_s: number, speed: number, now_ms: number): Swarm {
    const i = Math.max(this.indexAt(t_s), 0);
    const [step, next] = [this.steps[i], this.steps[i + 1]];
    if (!step) return NO_SWARM;
    const apart_s = next ? next.t - step.t : 0;
    const share = apart_s > 0 && apart_s <= GLIDE_S ? Math.min(Math.max((t_s - step.t) / apart_s, 0), 1) : 0;
    const shields = new Map((step.shields ?? []).map(([robot, ...rest]) => [robot, rest] as const));
    const lies = new Map(step.lies);
    const trails = step.at.length > MOST_WITH_TRAILS ? [] : this.steps.slice(Math.max(0, i - TRAIL_STEPS), i + 1);
    const robots = new Map<string, Robot>();
    // Drawn last: among two thousand robots it could be hidden.
    const above = (number: number) => Number(lies.has(number) || shields.get(number)?.[0] === true);
    const inOrder = step.at.map((place, k) => ({ place, k })).sort((a, b) => above(a.place[0]) - above(b.place[0]));
    inOrder.forEach(({ place: [number, x, y, heading], k }) => {
      const to = next?.at[k];
      const glides = to?.[0] === number;
      const at = glides ? [x + (to[1] - x) * share, y + (to[2] - y) * share] as const : [x, y] as const;
      const [safeMode, tokens] = shields.get(number) ?? [];
      const late_ms = (t_s - step.t) * 1000;
      const shield: Shield | undefined = tokens && {
        safeMode: safeMode === true,
        vouchers: tokens.map(([auditor, left_s]) => ({ auditor, until_ms: now_ms + left_s * 1000 - late_ms })),
      };
      const was = trails.flatMap((past) => {
        const place = past.at[k];
        return place?.[0] === number ? [this.#shown(place[1], place[2])] : [];
      });
      robots.set(String(number), {
        address: String(number),
        number,
        name: lies.has(number) ? texts.lies(number) : String(number),
        status: ACTIVE,
        mode: 0,
        direction: ((Math.atan2(-Math.cos(rad(heading)), -Math.sin(rad(heading))) * 180) / Math.PI + 360) % 360,
        position: this.#shown(...at),
        led: lies.has(number) ? LIAR : HONEST,
        waypoints: [],
        threshold: 0,
        trail: Trail.of(was),
        battery_v: undefined,
        shield,
        audited: undefined,
        walk: undefined,
        drivers: [],
      });
    });
    const lit = this.#marks.filter(({ t }) => t <= t_s).map(({ x, y, type }) => ({ ...this.#shown(x, y), type }));
    const missions: Missions = { walls: this.#drawn, progress: undefined, lit };
    const needed = Number(this.about["tokens_needed"]);
    const audited = this.about["defence"] !== "none" && needed > 0;
    return {
      ...NO_SWARM,
      robots,
      roster: [...robots.values()].map(({ address, name, status }) => ({ address, name, status })),
      area: this.#area,
      areaTold: true,
      listed: true,
      terms: audited ? { needed, full_ms: Number(this.about["t_val_ms"]) } : undefined,
      audits: this.#auditsAt(t_s, speed, now_ms),
      missions,
      at_ms: now_ms,
    };
  }

  #auditsAt(t_s: number, speed: number, now_ms: number): readonly Audit[] {
    const from_s = t_s - (speed * REFUSED_FOR_MS) / 1000;
    const audits: Audit[] = [];
    for (let i = this.indexAt(t_s); i >= 0; i -= 1) {
      const { t, audits: told } = this.steps[i] ?? { t: 0 };
      for (const [at_s, auditor, auditee, refusal] of told ?? []) {
        if (at_s <= from_s || at_s > t_s) continue;
        const at_ms = now_ms - ((t_s - at_s) * 1000) / speed;
        audits.push({ auditor: String(auditor), auditee: String(auditee), refusal, at_ms });
      }
      // A step contains what ended after it.
      if (t <= from_s) break;
    }
    // Refusals last, and on top.
    return audits.sort((a, b) => Number(a.refusal !== "") - Number(b.refusal !== "")).slice(-MOST_AUDITS);
  }
}

function rad(degrees: number): number {
  return (degrees * Math.PI) / 180;
}
