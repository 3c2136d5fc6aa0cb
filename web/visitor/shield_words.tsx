// The chosen robot's shield in words: how long it lives without new vouchers, who vouches, how its last audit ended.

import { counting, type Health, LOW_MS, type Robot, sentence, type Swarm, type SwarmLink, shortName, useSwarm } from "../client";

const LEGEND = `unknown
Robots audit each other.
Each arc of a ring is a neighbour that vouches.
A line is an audit: green passed, red refused.`;

const STOPPED = `stopped
Safe Mode: too few neighbours vouched for it.
It obeys nobody until the gateway starts again.`;

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
}

export function ShieldWords({ link, selected }: Props) {
  // A string: it renders again only when the words change, not at every frame.
  const words = useSwarm(link, ({ swarm, health }) => shieldWords(swarm, selected, isHeard(health)));
  const [state, ...lines] = words.split("\n");
  if (state === "none") return null;
  return (
    <div className="shield" data-testid="shield" data-state={state}>
      {lines.map((line, i) => (
        <p key={i}>{line}</p>
      ))}
    </div>
  );
}

/** Whether what the swarm says arrives now. */
function isHeard({ state }: Health): boolean {
  return state === "live";
}

/** The shield's state, then lines to show, as of the newest frame: always three of a robot, or the page would jump. */
export function shieldWords(swarm: Swarm, selected: string | undefined, heard = true): string {
  const { terms, at_ms } = swarm;
  if (swarm.unprotected !== "") return `unprotected\n${sentence(swarm.unprotected)}.`;
  if (!terms) return "none";
  const robot = selected === undefined ? undefined : swarm.robots.get(selected);
  if (!robot?.shield) return LEGEND;
  if (robot.shield.safeMode) return `${STOPPED}\n${lastAudit(swarm, robot)}`;
  // Seconds that stand still would be believed.
  if (!heard) return `unknown\nShield not known: no news from the swarm.\nWho vouches for it is not known.\n${lastAudit(swarm, robot)}`;
  const vouchers = counting(robot.shield, terms, at_ms);
  const names = vouchers.map(
    ({ auditor, until_ms }) => `${nameOf(swarm, auditor)} ${Math.ceil((until_ms - at_ms) / 1000)} s`,
  );
  // With the last one needed the robot is stopped.
  const last = vouchers[terms.needed - 1];
  const summary = last
    ? `${Math.ceil((last.until_ms - at_ms) / 1000)} s left without new vouchers`
    : `${terms.needed - vouchers.length} more must vouch for it`;
  return [
    !last ? "thin" : last.until_ms - at_ms < LOW_MS ? "low" : "whole",
    `Shield ${vouchers.length} of ${terms.needed}: ${summary}`,
    names.join(" · ") || "Nobody vouches for it yet.",
    lastAudit(swarm, robot),
  ].join("\n");
}

function lastAudit(swarm: Swarm, { audited }: Robot): string {
  if (!audited) return "No audit heard of yet.";
  const auditor = swarm.robots.get(audited.auditor);
  const by = auditor ? shortName(auditor) : "a robot that left";
  return audited.refusal === "" ? `Audited by ${by}: passed.` : `Refused by ${by}: ${audited.refusal}.`;
}

function nameOf(swarm: Swarm, number: number): string {
  const robot = swarm.robots.get(swarm.numbers.get(number) ?? "");
  return robot ? shortName(robot) : "?";
}
