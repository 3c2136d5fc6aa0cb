// Apply state updates to the known robots (docs/spec/vocabulary.md).

import type { Json, JsonObject } from "./core/json";
import { readWalk } from "./mission";
import { type Place, readRoute } from "./places";
import { objectsOf, readNumber, readPointXy } from "./reading";
import { type Robot, readDrivers, readRgb, readRobot, readStatus, readThreshold } from "./robot";
import { type Audit, readAudit, readShield } from "./shield";
import { type Point, Trail } from "./trail";

export const NOTIFY_FRAME = 16;

/** Most robots that are stored: ten times what the map is made for. */
export const MOST_ROBOTS = 2000;

export function list(words: Json | undefined): readonly Json[] {
  return Array.isArray(words) ? (words as readonly Json[]).slice(0, MOST_ROBOTS) : [];
}

/** Apply the parts of an update that no later one repeats; return its audits. */
export function lastingInFrame(
  robots: Map<string, Robot>,
  numbers: ReadonlyMap<number, string>,
  frame: JsonObject,
  at_ms: number,
): readonly Audit[] {
  for (const words of objectsOf(list(frame["changed"]))) changeInFrame(robots, words);
  for (const words of list(frame["routes"])) routeInFrame(robots, numbers, words);
  for (const words of list(frame["drivers"])) driversInFrame(robots, numbers, words);
  for (const words of list(frame["shields"])) shieldInFrame(robots, numbers, words, at_ms);
  for (const words of list(frame["walks"])) walkInFrame(robots, numbers, words);
  const audits = list(frame["audits"]).flatMap((words) => readAudit(words, numbers, at_ms) ?? []);
  for (const audit of audits) change(robots, audit.auditee, { audited: audit });
  return audits;
}

/** False for an unknown robot. */
export function moveInFrame(
  robots: Map<string, Robot>,
  numbers: ReadonlyMap<number, string>,
  { number, x, y, direction }: Place,
  step: number,
): boolean {
  const address = numbers.get(number);
  const robot = address === undefined ? undefined : robots.get(address);
  // Robots beyond the limit are ignored: no answer would add them.
  if (address === undefined || !robot) return robots.size >= MOST_ROBOTS;
  robots.set(address, { ...robot, direction });
  move(robots, address, readPointXy(x, y), step);
  return true;
}

/** `[number, safe, vouchers]`. */
function shieldInFrame(
  robots: Map<string, Robot>,
  numbers: ReadonlyMap<number, string>,
  words: Json,
  at_ms: number,
): void {
  if (!Array.isArray(words)) return;
  const [number, ...rest] = words as readonly Json[];
  const address = typeof number === "number" ? numbers.get(number) : undefined;
  const shield = readShield(rest, at_ms);
  if (address !== undefined && shield) change(robots, address, { shield });
}

/** `[number, phase, decoded, of, why]`. */
function walkInFrame(robots: Map<string, Robot>, numbers: ReadonlyMap<number, string>, words: Json): void {
  if (!Array.isArray(words)) return;
  const [number, ...rest] = words as readonly Json[];
  const address = typeof number === "number" ? numbers.get(number) : undefined;
  const walk = readWalk(rest);
  if (address !== undefined && walk) change(robots, address, { walk });
}

/** `[number, left, top, step, points]`. */
function routeInFrame(robots: Map<string, Robot>, numbers: ReadonlyMap<number, string>, words: Json): void {
  const route = readRoute(words);
  if (!route) return;
  const address = numbers.get(route.number);
  if (address === undefined) return;
  change(robots, address, { waypoints: route.points, mode: route.points.length > 0 ? 1 : 0 });
}

/** `[number, names]`. */
function driversInFrame(robots: Map<string, Robot>, numbers: ReadonlyMap<number, string>, words: Json): void {
  if (!Array.isArray(words)) return;
  const [number, names] = words as readonly Json[];
  const address = typeof number === "number" ? numbers.get(number) : undefined;
  const drivers = readDrivers(names);
  if (address !== undefined && drivers) change(robots, address, { drivers });
}

function changeInFrame(robots: Map<string, Robot>, words: JsonObject): void {
  const { address } = words;
  if (typeof address !== "string") return;
  const led = readRgb(words["rgb_led"]);
  const threshold = readThreshold(words["waypoints_threshold"]);
  const millivolts = readNumber(words["battery_mv"], 0, 100_000);
  const status = readStatus(words["status"]);
  change(robots, address, {
    ...(millivolts !== undefined && { battery_v: millivolts / 1000 }),
    ...(status !== undefined && { status }),
    ...(led && { led }),
    ...(threshold !== undefined && { threshold }),
    ...(words["history_cleared"] === true && { trail: Trail.EMPTY }),
  });
}

export function join(robots: Map<string, Robot>, words: Json | undefined): void {
  const robot = readRobot(words);
  if (robot && (robots.has(robot.address) || robots.size < MOST_ROBOTS)) robots.set(robot.address, robot);
}

export function change(robots: Map<string, Robot>, address: string, what: Partial<Robot>): void {
  const robot = robots.get(address);
  if (robot) robots.set(address, { ...robot, ...what });
}

/** The trail gets a point for every `step`. */
function move(robots: Map<string, Robot>, address: string, position: Point | undefined, step: number): void {
  const robot = robots.get(address);
  if (!robot || !position) return;
  const { trail } = robot;
  const last = trail.length - 1;
  const near = last >= 0 && Math.hypot(position.x - trail.x(last), position.y - trail.y(last)) < step;
  robots.set(address, { ...robot, position, trail: near ? trail : trail.append(position) });
}
