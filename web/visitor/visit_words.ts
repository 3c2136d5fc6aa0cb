// A visitor's own session as text.

import { type OverReason, shortName, type Swarm, type Visit } from "../client";
import { visitor as texts } from "../texts";

/** Why it is over: a title, instructions, and the label of a button to retry. */
export interface OverWords {
  readonly title: string;
  readonly text: string;
  readonly again: string | undefined;
}

export function overWords(reason: OverReason): OverWords {
  const again = reason === "replaced" ? texts.useThisTab : reason === "full" || reason === "too_many" ? texts.tryAgain : undefined;
  return { ...texts.over[reason], again };
}

const REFUSED_FOR_MS = 4000;

/** Why the newest command was refused, for a while; otherwise "". */
export function refusedWords({ refused }: Visit, now_ms: number): string {
  return refused && now_ms - refused.at_ms < REFUSED_FOR_MS ? texts.refused[refused.reason] : "";
}

/** This visitor's current rights in one sentence; "" if there is nothing to say. */
export function standingWords(visit: Visit, swarm: Swarm, now_ms: number): string {
  const { standing } = visit;
  if (visit.stage !== "here" || !standing) return "";
  if (standing.role === "watch") return texts.youWatch;
  if (standing.place > 0) return texts.inTheQueue(standing.place);
  if (standing.robot === "") return "";
  const robot = swarm.robots.get(standing.robot);
  const name = robot ? shortName(robot) : texts.aRobot;
  if (standing.left_ms === 0) return texts.isYours(name);
  const left_ms = Math.max(0, standing.left_ms - (now_ms - visit.standingAt_ms));
  return texts.isYoursFor(name, turnClock(left_ms));
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
