// The chosen robot's shield as text; after a tap also its vouchers, their remaining times, and its last audit.

import { counting, type Health, LOW_MS, type Robot, sentence, type Swarm, type SwarmLink, shortName, useSwarm, type Voucher } from "../client";
import { visitor as texts } from "../texts";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
}

export function ShieldWords({ link, selected }: Props) {
  // A string: it re-renders only when the text changes, not with every update.
  const words = useSwarm(link, ({ swarm, health }) => shieldWords(swarm, selected, isHeard(health)));
  const [state, line, ...details] = words.split("\n");
  if (state === "none") return null;
  if (details.length === 0) {
    return (
      <div className="shield" data-testid="shield" data-state={state}>
        <p>{line}</p>
      </div>
    );
  }
  return (
    <details className="shield" data-testid="shield" data-state={state}>
      <summary>{line}</summary>
      {details.map((detail, i) => (
        <p key={i}>{detail}</p>
      ))}
    </details>
  );
}

/** Whether updates arrive now. */
function isHeard({ state }: Health): boolean {
  return state === "live";
}

/** The shield's state: the line always shown, and details; as of the newest state update. */
export function shieldWords(swarm: Swarm, selected: string | undefined, heard = true): string {
  const { terms, at_ms } = swarm;
  if (swarm.unprotected !== "") return `unprotected\n${sentence(swarm.unprotected)}.`;
  if (!terms) return "none";
  const robot = selected === undefined ? undefined : swarm.robots.get(selected);
  if (!robot?.shield) return ["unknown", texts.checkEachOther, texts.whatRingsMean, texts.whatLinesMean].join("\n");
  const check = lastCheck(swarm, robot);
  if (robot.shield.safeMode) return ["stopped", texts.tooFewVouched, texts.obeysNobody, check].join("\n");
  // A stopped countdown would look valid.
  if (!heard) return ["unknown", texts.protectionUnknown, check].join("\n");
  const vouchers = counting(robot.shield, terms, at_ms);
  const left = ({ until_ms }: Voucher) => Math.ceil((until_ms - at_ms) / 1000);
  const names = vouchers.map((each) => texts.voucher(nameOf(swarm, each.auditor), left(each))).join(", ");
  const vouched = names === "" ? texts.nobodyVouches : texts.vouchFor(names);
  // Without the last needed voucher the robot is stopped.
  const last = vouchers[terms.needed - 1];
  if (!last) return ["thin", texts.tooFewVouch(vouchers.length, terms.needed), vouched, check].join("\n");
  const isLow = last.until_ms - at_ms < LOW_MS;
  const line = isLow ? texts.protectedFor(left(last)) : texts.protected(vouchers.length);
  return [isLow ? "low" : "whole", line, vouched, texts.stopsIn(left(last)), check].join("\n");
}

function lastCheck(swarm: Swarm, { audited }: Robot): string {
  if (!audited) return texts.noCheckYet;
  const auditor = swarm.robots.get(audited.auditor);
  const by = auditor ? shortName(auditor) : texts.aRobotThatLeft;
  if (audited.refusal === "") return texts.checkPassed(by);
  // The operator's page shows the auditor's original text.
  return texts.checkFailed(by, /^output|^checkpoint wrong/.test(audited.refusal) ? texts.didSomethingElse : texts.recordsDoNotAddUp);
}

function nameOf(swarm: Swarm, number: number): string {
  const robot = swarm.robots.get(swarm.numbers.get(number) ?? "");
  return robot ? shortName(robot) : "?";
}
