// The gateway's answer to /api/state, validated once, so that components need not handle missing fields.

import { type Drift, type Json, readDrift } from "../client";

export type LinkQuality = "ok" | "quiet" | "lost";

export interface Broker {
  readonly name: string;
  readonly url: string;
  readonly connected: boolean;
  /** Why phones cannot connect to it; "" if they can. */
  readonly trouble: string;
  readonly phones: string;
}

export interface Visitor {
  readonly id: string;
  /** Seconds since its last request. */
  readonly last_seen_s: number;
  readonly requests: number;
}

export const ROLES = ["watch", "drive", "operate"] as const;

/** A visitor with a session, connected or away for a while. */
export interface SessionVisitor {
  readonly visitor: number;
  readonly name: string;
  readonly role: (typeof ROLES)[number];
  /** Waits for the operator's approval. */
  readonly waiting: boolean;
  readonly present: boolean;
  /** Address of the robot that it drives or was assigned; "" for none. */
  readonly robot: string;
  /** Position in the queue for a robot, from 1; 0: not queued. */
  readonly place: number;
}

/** Mode session. */
export interface Session {
  /** Eight digits; undefined if hidden. */
  readonly room: string | undefined;
  /** New visitors are admitted without approval. */
  readonly open: boolean;
  readonly visitors: readonly SessionVisitor[];
}

export interface Rgb {
  readonly red: number;
  readonly green: number;
  readonly blue: number;
}

export interface Robot {
  readonly address: string;
  readonly name: string;
  /** 0 active, 1 inactive, 2 lost (docs/spec/vocabulary.md). */
  readonly status: 0 | 1 | 2;
  /** 0 manual, 1 following waypoints. */
  readonly mode: 0 | 1;
  readonly battery_v: number;
  readonly last_seen_s: number;
  readonly rgb_led: Rgb;
  readonly link: LinkQuality;
  /** Names of visitors whose joysticks drive it now. */
  readonly drivers: readonly string[];
}

export const COUNTERS = ["commands", "requests", "notifications", "knocks", "reconnects"] as const;
export type Counters = Readonly<Record<(typeof COUNTERS)[number], number>>;

/** State of a robot that the operator compromised. */
export interface Lie {
  readonly since_s: number;
  /** Time until it was stopped; undefined if it still runs. */
  readonly stopped_after_s: number | undefined;
}

export interface RobotShield {
  readonly safe_mode: boolean;
  /** Its attack; "" for an honest robot. */
  readonly attack: string;
  /** Undefined for an honest robot. */
  readonly lie: Lie | undefined;
  /** Neighbours that vouch for it, with the remaining seconds. */
  readonly vouchers: readonly { readonly name: string; readonly left_s: number }[];
}

export interface Attack {
  readonly name: string;
  readonly does: string;
}

/** A refused audit. */
export interface Refusal {
  readonly ago_s: number;
  readonly auditor: string;
  readonly auditee: string;
  readonly reason: string;
}

/** Shields of robots that audit each other. */
export interface Shields {
  readonly tokens_needed: number;
  readonly t_val_ms: number;
  /** Whether stopped robots can be revived: simulated ones only. */
  readonly revives: boolean;
  readonly attacks: readonly Attack[];
  /** Newest first. */
  readonly refusals: readonly Refusal[];
  readonly robots: Readonly<Record<string, RobotShield>>;
}

export const PHASES = ["waiting", "seeking", "returning", "held", "done"] as const;

/** A robot's progress in its mission. */
export interface Walk {
  readonly phase: (typeof PHASES)[number];
  readonly decoded: number;
  readonly of: number;
  readonly why: string;
  readonly drift: Drift;
}

/** The running mission, or the last one. */
export interface RunningMission {
  readonly id: string;
  readonly name: string;
  readonly nodes: number;
  readonly left: number;
  readonly completed: number;
}

/** State of robots on missions. */
export interface Missions {
  readonly world: string;
  readonly running: RunningMission | undefined;
  readonly robots: Readonly<Record<string, Walk>>;
}

export interface GatewayState {
  readonly mode: string;
  /** The operator has stopped all robots. */
  readonly held: boolean;
  readonly page_url: string;
  /** The projector's page, with its token; "" if there is none. */
  readonly projector: string;
  readonly qr_url: string;
  readonly qr_svg: string;
  readonly rotates_in_s: number;
  readonly rotate_s: number;
  readonly overlap_s: number;
  readonly overlapping: boolean;
  readonly uptime_s: number;
  readonly broker: Broker;
  readonly visitors: readonly Visitor[];
  /** Undefined for a gateway without sessions. */
  readonly session: Session | undefined;
  readonly robots: readonly Robot[];
  /** Undefined where robots do not audit each other. */
  readonly shields: Shields | undefined;
  /** Why robots are unprotected, if operators may expect otherwise; or "". */
  readonly unprotected: string;
  /** Undefined if robots have no missions. */
  readonly mission: Missions | undefined;
  readonly counters: Counters;
  /** Refused messages by reason; reasons without refusals may be absent. */
  readonly rejected: Readonly<Record<string, number>>;
}

/** The answer is not a gateway's state: most likely the gateway has another version. */
export class NotAState extends Error {
  constructor(where: string) {
    super(`the gateway's answer has no usable "${where}"`);
    this.name = "NotAState";
  }
}

/** @throws NotAState */
export function parseState(json: unknown): GatewayState {
  const state = record(json, "state");
  const broker = record(state["broker"], "broker");
  const counters = record(state["counters"], "counters");
  return {
    mode: text(state["mode"], "mode"),
    held: state["held"] === true,
    page_url: text(state["page_url"], "page_url"),
    projector: typeof state["projector"] === "string" && state["projector"].startsWith("/projector#") ? state["projector"] : "",
    qr_url: text(state["qr_url"], "qr_url"),
    qr_svg: text(state["qr_svg"], "qr_svg"),
    rotates_in_s: finite(state["rotates_in_s"], "rotates_in_s"),
    rotate_s: finite(state["rotate_s"], "rotate_s"),
    overlap_s: finite(state["overlap_s"], "overlap_s"),
    overlapping: state["overlapping"] === true,
    uptime_s: finite(state["uptime_s"], "uptime_s"),
    broker: {
      name: text(broker["name"], "broker.name"),
      url: text(broker["url"], "broker.url"),
      connected: broker["connected"] === true,
      trouble: typeof broker["trouble"] === "string" ? broker["trouble"] : "",
      phones: typeof broker["phones"] === "string" ? broker["phones"] : "",
    },
    // Those with sessions are in `session`.
    visitors: list(state["visitors"], "visitors").flatMap((each) => (isOfSession(each) ? [] : [visitor(each)])),
    session: state["session"] === undefined ? undefined : session(state["session"]),
    robots: list(state["robots"], "robots").map(robot),
    shields: state["shields"] === null ? undefined : shields(state["shields"]),
    unprotected: typeof state["unprotected"] === "string" ? state["unprotected"] : "",
    mission: state["mission"] === null ? undefined : missions(state["mission"]),
    counters: Object.fromEntries(COUNTERS.map((name) => [name, finite(counters[name], name)])) as Counters,
    rejected: Object.fromEntries(
      Object.entries(record(state["rejected"], "rejected")).map(([reason, n]) => [reason, finite(n, reason)]),
    ),
  };
}

function isOfSession(json: unknown): boolean {
  return record(json, "visitor")["visitor"] !== undefined;
}

function visitor(json: unknown): Visitor {
  const it = record(json, "visitor");
  return {
    id: text(it["id"], "visitor.id"),
    last_seen_s: finite(it["last_seen_s"], "visitor.last_seen_s"),
    requests: finite(it["requests"], "visitor.requests"),
  };
}

function session(json: unknown): Session {
  const it = record(json, "session");
  return {
    room: it["room"] === null ? undefined : text(it["room"], "session.room"),
    open: it["open"] === true,
    visitors: list(it["visitors"], "session.visitors").map((each) => {
      const visitor = record(each, "session.visitor");
      return {
        visitor: finite(visitor["visitor"], "visitor.visitor"),
        name: text(visitor["name"], "visitor.name"),
        role: oneOf(visitor["role"], ROLES, "visitor.role"),
        waiting: visitor["waiting"] === true,
        present: visitor["present"] === true,
        robot: text(visitor["robot"], "visitor.robot"),
        place: finite(visitor["place"], "visitor.place"),
      };
    }),
  };
}

function robot(json: unknown): Robot {
  const it = record(json, "robot");
  const led = record(it["rgb_led"], "robot.rgb_led");
  return {
    address: text(it["address"], "robot.address"),
    name: text(it["name"], "robot.name"),
    status: oneOf(it["status"], [0, 1, 2] as const, "robot.status"),
    mode: oneOf(it["mode"], [0, 1] as const, "robot.mode"),
    battery_v: finite(it["battery_v"], "robot.battery_v"),
    last_seen_s: finite(it["last_seen_s"], "robot.last_seen_s"),
    rgb_led: {
      red: finite(led["red"], "robot.rgb_led"),
      green: finite(led["green"], "robot.rgb_led"),
      blue: finite(led["blue"], "robot.rgb_led"),
    },
    link: oneOf(it["link"], ["ok", "quiet", "lost"] as const, "robot.link"),
    drivers: list(it["drivers"] ?? [], "robot.drivers").map((name) => text(name, "robot.drivers")),
  };
}

function shields(json: unknown): Shields {
  const it = record(json, "shields");
  return {
    tokens_needed: finite(it["tokens_needed"], "shields.tokens_needed"),
    t_val_ms: finite(it["t_val_ms"], "shields.t_val_ms"),
    revives: it["revives"] === true,
    attacks: list(it["attacks"], "shields.attacks").map((each) => {
      const attack = record(each, "attack");
      return { name: text(attack["name"], "attack.name"), does: text(attack["does"], "attack.does") };
    }),
    refusals: list(it["refusals"], "shields.refusals").map((each) => {
      const refusal = record(each, "refusal");
      return {
        ago_s: finite(refusal["ago_s"], "refusal.ago_s"),
        auditor: text(refusal["auditor"], "refusal.auditor"),
        auditee: text(refusal["auditee"], "refusal.auditee"),
        reason: text(refusal["reason"], "refusal.reason"),
      };
    }),
    robots: Object.fromEntries(
      Object.entries(record(it["robots"], "shields.robots")).map(([address, each]) => [address, robotShield(each)]),
    ),
  };
}

function robotShield(json: unknown): RobotShield {
  const it = record(json, "shield");
  return {
    safe_mode: it["safe_mode"] === true,
    attack: text(it["attack"], "shield.attack"),
    lie: it["lie"] === null ? undefined : lie(it["lie"]),
    vouchers: list(it["vouchers"], "shield.vouchers").map((each) => {
      const voucher = record(each, "voucher");
      return { name: text(voucher["name"], "voucher.name"), left_s: finite(voucher["left_s"], "voucher.left_s") };
    }),
  };
}

function lie(json: unknown): Lie {
  const it = record(json, "lie");
  const took = it["stopped_after_s"];
  return {
    since_s: finite(it["since_s"], "lie.since_s"),
    stopped_after_s: took === null ? undefined : finite(took, "lie.stopped_after_s"),
  };
}

function missions(json: unknown): Missions {
  const it = record(json, "mission");
  return {
    world: text(it["world"], "mission.world"),
    running: it["running"] === null ? undefined : runningMission(it["running"]),
    robots: Object.fromEntries(
      Object.entries(record(it["robots"], "mission.robots")).map(([address, each]) => [address, walk(each)]),
    ),
  };
}

function runningMission(json: unknown): RunningMission {
  const it = record(json, "mission.running");
  return {
    id: text(it["id"], "running.id"),
    name: text(it["name"], "running.name"),
    nodes: finite(it["nodes"], "running.nodes"),
    left: finite(it["left"], "running.left"),
    completed: finite(it["completed"], "running.completed"),
  };
}

function walk(json: unknown): Walk {
  const it = record(json, "walk");
  return {
    phase: oneOf(it["phase"], PHASES, "walk.phase"),
    decoded: finite(it["decoded"], "walk.decoded"),
    of: finite(it["of"], "walk.of"),
    why: text(it["why"], "walk.why"),
    drift: readDrift(it["drift"] as Json | undefined),
  };
}

function record(json: unknown, where: string): Record<string, unknown> {
  if (typeof json !== "object" || json === null || Array.isArray(json)) throw new NotAState(where);
  return json as Record<string, unknown>;
}

function list(json: unknown, where: string): readonly unknown[] {
  if (!Array.isArray(json)) throw new NotAState(where);
  return json;
}

function text(json: unknown, where: string): string {
  if (typeof json !== "string") throw new NotAState(where);
  return json;
}

function finite(json: unknown, where: string): number {
  if (typeof json !== "number" || !Number.isFinite(json)) throw new NotAState(where);
  return json;
}

function oneOf<T>(json: unknown, allowed: readonly T[], where: string): T {
  if (!allowed.includes(json as T)) throw new NotAState(where);
  return json as T;
}
