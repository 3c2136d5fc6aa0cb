// A visitor's own session in plain words.

import { type OverReason, type Reason, shortName, type Swarm, type Visit } from "../client";

/** Why it is over: a title, what to do, and the label of a button that tries again. */
export interface OverWords {
  readonly title: string;
  readonly text: string;
  readonly again: string | undefined;
}

const OVER: Readonly<Record<OverReason, OverWords>> = {
  removed: {
    title: "The operator removed you",
    text: "Your session has ended. To come back, scan the new code on the screen and wait until the operator lets you in.",
    again: undefined,
  },
  new_code: {
    title: "The operator ended this round",
    text: "All visitors were logged out. To join again, scan the new code on the screen.",
    again: undefined,
  },
  replaced: {
    title: "Continued in another tab",
    text: "You are connected from another tab or window. A visitor has one connection at a time.",
    again: "Use this tab",
  },
  full: { title: "No place is free", text: "The swarm has as many visitors as it can take.", again: "Try again" },
  code: {
    title: "This code is no longer valid",
    text: "Scan the code that is on the screen now.",
    again: undefined,
  },
  too_many: {
    title: "Too many tries",
    text: "Codes were tried too often from this network. Scan the QR code, or wait for some minutes.",
    again: "Try again",
  },
};

export function overWords(reason: OverReason): OverWords {
  return OVER[reason];
}

const REFUSED: Readonly<Record<Reason, string>> = {
  late: "Your command arrived too late: the connection is slow",
  not_allowed: "You may not drive this robot",
  busy: "Another visitor drives this robot: only that one and the operator stop it",
  too_many: "Too many commands at once",
  bad: "The robot cannot do that",
  unknown: "This robot is not there any more",
  held: "The operator has stopped all robots",
  failed: "The robot did not obey: tell the operator",
};
const REFUSED_FOR_MS = 4000;

/** Why the newest command was refused, for a while; else "". */
export function refusedWords({ refused }: Visit, now_ms: number): string {
  return refused && now_ms - refused.at_ms < REFUSED_FOR_MS ? REFUSED[refused.reason] : "";
}

/** What this visitor may do now, in one sentence; "" when there is nothing to say. */
export function standingWords(visit: Visit, swarm: Swarm, now_ms: number): string {
  const { standing } = visit;
  if (visit.stage !== "here" || !standing) return "";
  if (standing.role === "watch") return "You are watching. The operator can let you drive.";
  if (standing.place > 0) return `You are number ${standing.place} in the queue for a robot.`;
  if (standing.robot === "") return "";
  const robot = swarm.robots.get(standing.robot);
  const name = robot ? shortName(robot) : "A robot";
  if (standing.left_ms === 0) return `${name} is yours.`;
  const left_ms = Math.max(0, standing.left_ms - (now_ms - visit.standingAt_ms));
  return `${name} is yours for ${turnClock(left_ms)}, then the next visitor's.`;
}

/** "1:05", "0:09". */
export function turnClock(left_ms: number): string {
  const s = Math.ceil(left_ms / 1000);
  return `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`;
}

/** Whether this visitor may send commands at all. */
export function mayDrive({ standing }: Visit): boolean {
  return standing !== undefined && standing.role !== "watch" && !standing.waiting && standing.place === 0;
}
