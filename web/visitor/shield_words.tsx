// The chosen robot's shield in words: who vouches for it and for how long, and how its last audit ended.

import { counting, type Robot, type Swarm, type SwarmLink, shortName, useSwarm } from "../client";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
}

export function ShieldWords({ link, selected }: Props) {
  // A string: it renders again only when the words change, not at every frame.
  const words = useSwarm(link, ({ swarm }) => shieldWords(swarm, selected));
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

/** The shield's state, then lines to show; as of the newest frame. */
export function shieldWords(swarm: Swarm, selected: string | undefined): string {
  const { terms, at_ms } = swarm;
  if (!terms) return "none";
  const robot = selected === undefined ? undefined : swarm.robots.get(selected);
  if (!robot?.shield) return "unknown\nRobots audit each other:\neach arc of a ring is a neighbour that vouches.";
  if (robot.shield.safeMode)
    return ["stopped", "Safe Mode: too few neighbours vouched for it.", lastAudit(swarm, robot)].join("\n");
  const vouchers = counting(robot.shield, terms, at_ms);
  const names = vouchers.map(
    ({ auditor, until_ms }) => `${nameOf(swarm, auditor)} ${Math.ceil((until_ms - at_ms) / 1000)} s`,
  );
  const summary = `Shield ${vouchers.length} of ${terms.needed}: ${names.join(" · ") || "nobody vouches for it"}`;
  const state = vouchers.length < terms.needed ? "thin" : "whole";
  return [state, summary, lastAudit(swarm, robot)].join("\n");
}

function lastAudit(swarm: Swarm, { audited }: Robot): string {
  if (!audited) return "No audit heard of yet.";
  const auditor = swarm.robots.get(audited.auditor);
  const by = auditor ? shortName(auditor) : "a robot that left";
  return audited.refusal === "" ? `Last audit: passed, by ${by}.` : `Last audit: ${by} refused it, ${audited.refusal}.`;
}

function nameOf(swarm: Swarm, number: number): string {
  const robot = swarm.robots.get(swarm.numbers.get(number) ?? "");
  return robot ? shortName(robot) : "?";
}
