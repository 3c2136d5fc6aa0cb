// A robot as in the vocabulary (docs/spec/vocabulary.md), read from untrusted values.

import { isObject, type Json } from "./core/json";
import type { Walk } from "./mission";
import { MOST_WAYPOINTS } from "./places";
import { readNumber, readPoint, readText } from "./reading";
import type { Audit, Shield } from "./shield";
import { type Point, Trail } from "./trail";

export const ACTIVE = 0;
export const INACTIVE = 1;
export const LOST = 2;

export interface Rgb {
  readonly red: number;
  readonly green: number;
  readonly blue: number;
}

export interface Robot {
  readonly address: string;
  /** Its number in updates. */
  readonly number: number | undefined;
  readonly name: string;
  readonly status: number;
  /** 0 manual, 1 following waypoints. */
  readonly mode: number;
  /** Degrees: 0 faces +y, clockwise on the screen. */
  readonly direction: number | undefined;
  readonly position: Point | undefined;
  readonly led: Rgb | undefined;
  readonly waypoints: readonly Point[];
  readonly threshold: number;
  readonly trail: Trail;
  readonly battery_v: number | undefined;
  /** Undefined if robots do not audit each other. */
  readonly shield: Shield | undefined;
  /** Its last known audit. */
  readonly audited: Audit | undefined;
  /** Undefined if robots have no missions. */
  readonly walk: Walk | undefined;
  /** Nicknames of its joystick drivers; "" for drivers without names. */
  readonly drivers: readonly string[];
}

const ADDRESS = /^[0-9A-Za-z_-]{1,64}$/;
const LONGEST_NAME = 32;
const MOST_DRIVERS = 4;
/** Length of a nickname in sessions. */
const LONGEST_DRIVER = 32;
const LONGEST_ON_MAP = 12;
export const DEFAULT_THRESHOLD = 40;
export const UNNAMED = "Robot";

/** Read a robot from an answer to request 0, or from `joined`. Undefined without an address. */
export function readRobot(words: Json | undefined): Robot | undefined {
  const address = isObject(words) ? words["address"] : undefined;
  if (!isObject(words) || typeof address !== "string" || !ADDRESS.test(address)) return undefined;
  return {
    address,
    number: readNumber(words["n"], 0, Number.MAX_SAFE_INTEGER),
    name: readText(words["name"], LONGEST_NAME) ?? UNNAMED,
    status: readStatus(words["status"]) ?? ACTIVE,
    mode: readMode(words["mode"]) ?? 0,
    direction: readDirection(words["direction"]),
    position: readPoint(words["lh2_position"]),
    led: readRgb(words["rgb_led"]),
    waypoints: readWaypoints(words["waypoints"]) ?? [],
    threshold: readThreshold(words["waypoints_threshold"]) ?? DEFAULT_THRESHOLD,
    trail: readTrail(words["position_history"]) ?? Trail.EMPTY,
    battery_v: readBattery(words["battery"]),
    shield: undefined,
    audited: undefined,
    walk: undefined,
    drivers: readDrivers(words["drivers"]) ?? [],
  };
}

export function readDrivers(words: Json | undefined): readonly string[] | undefined {
  if (!Array.isArray(words)) return undefined;
  return (words as readonly Json[]).slice(0, MOST_DRIVERS).map((name) => readText(name, LONGEST_DRIVER) ?? "");
}

export function readDirection(word: unknown): number | undefined {
  // PyDotBot 0.30 sends -1000 for "unknown".
  const degrees = readNumber(word, -360, 720);
  return degrees === undefined ? undefined : ((degrees % 360) + 360) % 360;
}

export function readRgb(words: Json | undefined): Rgb | undefined {
  if (!isObject(words)) return undefined;
  const [red, green, blue] = [words["red"], words["green"], words["blue"]].map((word) => readNumber(word, 0, 255));
  if (red === undefined || green === undefined || blue === undefined) return undefined;
  return { red: Math.round(red), green: Math.round(green), blue: Math.round(blue) };
}

export function readWaypoints(words: Json | undefined): readonly Point[] | undefined {
  return readPoints(words, MOST_WAYPOINTS);
}

export function readThreshold(word: unknown): number | undefined {
  return readNumber(word, 0, 1000);
}

export function readStatus(word: unknown): number | undefined {
  return word === ACTIVE || word === INACTIVE || word === LOST ? word : undefined;
}

export function readMode(word: unknown): number | undefined {
  return word === 0 || word === 1 ? word : undefined;
}

export function readBattery(word: unknown): number | undefined {
  return readNumber(word, 0, 100);
}

export function readTrail(words: Json | undefined): Trail | undefined {
  const points = Array.isArray(words) ? readPoints(words.slice(-1000), 1000) : undefined;
  return points && Trail.of(points);
}

function readPoints(words: Json | undefined, most: number): readonly Point[] | undefined {
  if (!Array.isArray(words)) return undefined;
  const points: Point[] = [];
  for (const word of (words as readonly Json[]).slice(0, most)) {
    const point = readPoint(word);
    if (point) points.push(point);
  }
  return points;
}

/** Distinguishes two robots of the same name. */
export function shortAddress(address: string): string {
  return address.slice(-4);
}

/** As in the list of robots, also for screen readers. */
export function label(robot: { readonly name: string; readonly address: string }): string {
  return `${robot.name} (${shortAddress(robot.address)})`;
}

/** For the map: older servers send no names, and "Robot" everywhere would not help. */
export function shortName(robot: { readonly name: string; readonly address: string }): string {
  return robot.name === UNNAMED ? shortAddress(robot.address) : robot.name;
}

/** For the map: a robot, and its drivers. */
export function nameWithDriver(robot: Pick<Robot, "name" | "address" | "drivers">): string {
  const [driver = ""] = robot.drivers;
  const letters = Array.from(driver);
  const who = letters.length > LONGEST_ON_MAP ? `${letters.slice(0, LONGEST_ON_MAP - 1).join("")}…` : driver;
  return who === "" ? shortName(robot) : `${shortName(robot)} · ${who}`;
}

/** Turn a gateway's lower-case text, as in its log, into a sentence. */
export function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
