// The swarm's state at a visitor: a pure reducer of answers and notifications (docs/spec/vocabulary.md).
//
// It reads our gateway's updates and tolerates anything else: a hostile peer can make it show nonsense within bounds, but
// never throw or grow without end.

import { isObject, type Json, type JsonObject } from "./core/json";
import { type Missions, missionsInFrame, readMissions, readWalk, readWalls, withLit } from "./mission";
import { change, join, lastingInFrame, list, MOST_ROBOTS, moveInFrame, NOTIFY_FRAME } from "./frame";
import type { Said } from "./lately";
import { readPlaces } from "./places";
import { objectsOf, readNumber, readText } from "./reading";
import { type Robot, readRobot } from "./robot";
import { type Audit, readShield, readTerms, readVerdict, type ShieldTerms } from "./shield";
import { Trail } from "./trail";
import { type Work, workInFrame } from "./work";

export const REQUEST_ROBOTS = 0;
export const REQUEST_AREA = 1;
export const REQUEST_WALLS = 2;
export const REQUEST_LIT = 3;

const LARGEST_AREA_MM = 1e7;
/** Limit of a server that does not send one. */
const MOST_WAYPOINTS = 64;
// A trail point per this fraction of the area's width: 10 mm of 2 m.
const TRAIL_STEP = 0.005;
/** Time for which a map may show audits. */
const AUDITS_FOR_MS = 3000;
const MOST_AUDITS = 256;
const LONGEST_NOTE = 160;

/** The swarm's area, in millimetres. */
export interface Area {
  readonly width: number;
  readonly height: number;
}

const DEFAULT_AREA: Area = { width: 2000, height: 2000 };

export interface Swarm {
  readonly robots: ReadonlyMap<string, Robot>;
  /** Changes only when a robot joins, leaves, or changes its name or status, so lists are not redrawn with every update. */
  readonly roster: readonly RosterEntry[];
  /** Addresses by number in updates. */
  readonly numbers: ReadonlyMap<number, string>;
  readonly area: Area;
  /** Largest number of points in a route. */
  readonly mostWaypoints: number;
  /** Whether request 1 was answered; until then the area is a guess. */
  readonly areaTold: boolean;
  /** Whether request 0 was ever answered: before that, unknown robots in updates are expected. */
  readonly listed: boolean;
  /** The newest update's number. */
  readonly seq: number | undefined;
  /** Counts missed updates: when it changes, request 0 has to be repeated. */
  readonly missed: number;
  /** Undefined if robots do not audit each other. */
  readonly terms: ShieldTerms | undefined;
  /** Why they do not, if visitors may expect it; otherwise "". */
  readonly unprotected: string;
  /** Recent audits, oldest first. */
  readonly audits: readonly Audit[];
  /** The operator has stopped all robots. */
  readonly held: boolean;
  /** Undefined if robots have no missions. */
  readonly missions: Missions | undefined;
  /** Undefined if robots have no task of their own. */
  readonly work: Work | undefined;
  /** When the newest answer or update arrived. */
  readonly at_ms: number;
}

export interface RosterEntry {
  readonly address: string;
  readonly name: string;
  readonly status: number;
}

export const NO_SWARM: Swarm = {
  robots: new Map(),
  numbers: new Map(),
  roster: [],
  area: DEFAULT_AREA,
  mostWaypoints: MOST_WAYPOINTS,
  areaTold: false,
  listed: false,
  seq: undefined,
  missed: 0,
  terms: undefined,
  unprotected: "",
  audits: [],
  held: false,
  missions: undefined,
  work: undefined,
  at_ms: 0,
};

export type SwarmAction =
  /** `said`: recent updates, some of them newer than the answer. */
  | {
      readonly kind: "replied";
      readonly request: number;
      readonly data: Json;
      readonly at_ms: number;
      readonly said?: readonly Said[];
    }
  | { readonly kind: "notified"; readonly payload: Json; readonly at_ms: number }
  /** Reconnected: updates were missed, but request 0 is being sent anyway. */
  | { readonly kind: "reconnected" }
  /** We asked a robot to clear its trail: the map does not wait for the confirmation. */
  | { readonly kind: "history_cleared"; readonly address: string };

/** Times (`at_ms`) are the caller's, on any monotonic clock. */
export function swarmReducer(swarm: Swarm, action: SwarmAction): Swarm {
  switch (action.kind) {
    case "replied":
      if (action.request === REQUEST_ROBOTS) {
        return withSaid(withRobots(swarm, action.data, action.at_ms), action.said ?? []);
      }
      if (action.request === REQUEST_AREA) return withArea(swarm, action.data);
      return swarm.missions ? { ...swarm, missions: withMap(swarm.missions, action.request, action.data) } : swarm;
    case "notified":
      return notified(swarm, action.payload, action.at_ms);
    case "reconnected":
      return { ...swarm, seq: undefined };
    case "history_cleared":
      return edited(swarm, (robots) => change(robots, action.address, { trail: Trail.EMPTY }));
  }
}

function notified(swarm: Swarm, payload: Json, at_ms: number): Swarm {
  if (!isObject(payload)) return swarm;
  const { cmd, data } = payload;
  return cmd === NOTIFY_FRAME && isObject(data) ? framed(swarm, data, at_ms) : swarm;
}

function withRobots(swarm: Swarm, data: Json, at_ms: number): Swarm {
  if (!Array.isArray(data)) return swarm;
  const listed: Robot[] = [];
  const verdicts: (Json | undefined)[] = [];
  for (const words of (data as readonly Json[]).slice(0, MOST_ROBOTS)) {
    const robot = readRobot(words);
    if (!robot || !isObject(words)) continue;
    const shield = readShield(words["shield"], at_ms);
    const walk = readWalk(words["walk"]);
    listed.push({ ...robot, shield, walk, audited: swarm.robots.get(robot.address)?.audited });
    verdicts.push(words["audited"]);
  }
  // An answer above the client's limit has no histories: the trail seen meanwhile is kept.
  // Our gateway sends only the newest points.
  const trimmed = listed.length > 1 && listed.every((robot) => robot.trail.length === 0);
  const robots = new Map<string, Robot>();
  for (const robot of listed) {
    const known = swarm.robots.get(robot.address);
    const shorter = known && robot.trail.length < known.trail.length && (trimmed || robot.trail.length > 0);
    robots.set(robot.address, shorter ? { ...robot, trail: known.trail } : robot);
  }
  const numbers = numbersOf(robots);
  listed.forEach(({ address }, i) => {
    const audited = readVerdict(verdicts[i], address, numbers, at_ms);
    if (audited) change(robots, address, { audited });
  });
  return settled({ ...swarm, robots, numbers, listed: true, at_ms });
}

/** A list, with newer updates applied. */
function withSaid(swarm: Swarm, said: readonly Said[]): Swarm {
  if (said.length === 0) return swarm;
  let { numbers } = swarm;
  const next = edited(swarm, (robots) => {
    for (const { words: frame, at_ms } of said) {
      const joined = objectsOf(list(frame["joined"]));
      for (const words of joined) if (!robots.has(words["address"] as string)) join(robots, words);
      if (joined.length > 0) numbers = numbersOf(robots);
      lastingInFrame(robots, numbers, frame, at_ms);
      for (const address of list(frame["left"])) if (typeof address === "string") robots.delete(address);
    }
  });
  return { ...next, numbers };
}

function withArea(swarm: Swarm, data: Json): Swarm {
  if (!isObject(data)) return swarm;
  const width = readNumber(data["width"], 1, LARGEST_AREA_MM);
  const height = readNumber(data["height"], 1, LARGEST_AREA_MM);
  if (width === undefined || height === undefined) return swarm;
  const missions = readMissions(data, swarm.missions);
  const unprotected = readText(data["unprotected"], LONGEST_NOTE) ?? "";
  const mostWaypoints = readNumber(data["most_waypoints"], 1, MOST_WAYPOINTS) ?? MOST_WAYPOINTS;
  const area: Area = { width, height };
  return { ...swarm, area, mostWaypoints, areaTold: true, terms: readTerms(data), unprotected, missions };
}

function withMap(missions: Missions, request: number, data: Json): Missions {
  if (request === REQUEST_WALLS) return { ...missions, walls: readWalls(data) ?? missions.walls };
  if (request === REQUEST_LIT) return { ...missions, lit: withLit(missions.lit, data) };
  return missions;
}

function framed(swarm: Swarm, frame: JsonObject, at_ms: number): Swarm {
  const seq = readNumber(frame["seq"], 0, Number.MAX_SAFE_INTEGER);
  if (seq === undefined || !Number.isInteger(seq)) return swarm;
  let missed = swarm.seq !== undefined && seq !== swarm.seq + 1;
  let { numbers } = swarm;
  let ended: readonly Audit[] = [];
  const step = TRAIL_STEP * swarm.area.width;
  const next = edited(swarm, (robots) => {
    const joined = list(frame["joined"]);
    for (const words of joined) join(robots, words);
    if (joined.length > 0) numbers = numbersOf(robots);
    for (const place of readPlaces(frame["places"])) {
      if (!moveInFrame(robots, numbers, place, step)) missed ||= swarm.listed;
    }
    ended = lastingInFrame(robots, numbers, frame, at_ms);
    for (const address of list(frame["left"])) if (typeof address === "string") robots.delete(address);
  });
  const told = swarm.missions && missionsInFrame(swarm.missions, frame);
  // Landmarks decoded before this update were missed.
  if (told?.another === true) missed = true;
  const recent = swarm.audits.filter((audit) => at_ms - audit.at_ms < AUDITS_FOR_MS);
  const audits = [...recent, ...ended].slice(-MOST_AUDITS);
  const held = frame["held"] === true;
  const work = workInFrame(swarm.work, frame);
  return { ...next, numbers, seq, audits, held, work, missions: told?.missions, at_ms, missed: next.missed + (missed ? 1 : 0) };
}

/** Drivers of this robot except `me`. */
export function driversOf(swarm: Swarm, address: string | undefined, me: string): readonly string[] {
  const names = address === undefined ? undefined : swarm.robots.get(address)?.drivers;
  return names?.filter((name) => name !== me) ?? [];
}

function numbersOf(robots: ReadonlyMap<string, Robot>): ReadonlyMap<number, string> {
  const numbers = new Map<number, string>();
  for (const { address, number } of robots.values()) if (number !== undefined) numbers.set(number, address);
  return numbers;
}

function edited(swarm: Swarm, edit: (robots: Map<string, Robot>) => void): Swarm {
  const robots = new Map(swarm.robots);
  edit(robots);
  return settled({ ...swarm, robots });
}

/** With the roster updated. */
function settled(swarm: Swarm): Swarm {
  const { robots, roster } = swarm;
  const same =
    roster.length === robots.size &&
    roster.every((entry) => {
      const robot = robots.get(entry.address);
      return robot && robot.name === entry.name && robot.status === entry.status;
    });
  return {
    ...swarm,
    roster: same
      ? roster
      : [...robots.values()].map(({ address, name, status }) => ({ address, name, status })).sort(byName),
  };
}

function byName(a: RosterEntry, b: RosterEntry): number {
  // Numbers within names in numeric order: robot 2 before robot 10. Addresses make the order total.
  return collator.compare(a.name, b.name) || (a.address < b.address ? -1 : 1);
}

const collator = new Intl.Collator("en", { numeric: true });
