// The badge: one line on the connection's state, and what to do about problems.

import type { Health } from "../client";
import { common, visitor as texts } from "../texts";

export type BadgeState = Health["state"] | "held" | "nocode";

interface Words {
  readonly state: BadgeState;
  readonly text: string;
}

/** The other end: a broker, or the swarm itself. */
export interface Where {
  readonly via: "broker" | "direct";
  readonly host: string;
}

/** The connection's state as text. `held`: the operator stopped all robots. */
export function badgeWords(health: Health, where: Where, robots: number, held = false): Words {
  const isDirect = where.via === "direct";
  switch (health.state) {
    case "connecting":
      return {
        state: "connecting",
        text: health.broker === "reached" ? texts.lookingForTheSwarm : texts.connecting,
      };
    case "offline":
      return { state: "offline", text: texts.offline[isDirect && health.why === "broker" ? "direct" : health.why](where.host) };
    case "waiting":
      return { state: "waiting", text: texts.waitingForTheOperator };
    case "over":
      return { state: "over", text: texts.sessionHasEnded };
    case "late":
      return { state: "late", text: texts.noNews };
    case "silent":
      return { state: "silent", text: isDirect ? texts.silent : texts.silentScanAgain };
    case "unanswered":
      return { state: "unanswered", text: texts.unanswered };
    case "live":
      if (held) return { state: "held", text: texts.held };
      return { state: "live", text: texts.live(common.robots(robots)) };
  }
}

/** Host and port of a broker's URL. */
export function hostOf(broker: string): string {
  const url = new URL(broker);
  return `${url.hostname}:${url.port || (url.protocol === "wss:" ? 443 : 80)}`;
}

export function Badge({ state, text }: Words) {
  return (
    <p className="badge" role="status" aria-live="polite" data-testid="badge" data-state={state}>
      <span className="badge-dot" aria-hidden="true" />
      <span>{text}</span>
    </p>
  );
}
