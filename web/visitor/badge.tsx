// The badge: one line that says whether all is well, and if not, what is wrong and what to do.

import type { Health } from "../client";

export type BadgeState = Health["state"] | "held" | "nocode";

interface Words {
  readonly state: BadgeState;
  readonly text: string;
}

/** Where the other end is: a broker, or the swarm itself. */
export interface Where {
  readonly via: "broker" | "direct";
  readonly host: string;
}

/** Plain words for the health of the link. `held`: the operator stopped all. */
export function badgeWords(health: Health, where: Where, robots: number, held = false): Words {
  const isDirect = where.via === "direct";
  switch (health.state) {
    case "connecting":
      return {
        state: "connecting",
        text: health.broker === "reached" ? "Looking for the swarm…" : `Connecting to the ${isDirect ? "swarm" : "broker"}…`,
      };
    case "offline":
      return { state: "offline", text: OFFLINE[isDirect && health.why === "broker" ? "direct" : health.why](where) };
    case "waiting":
      return { state: "waiting", text: "Waiting for the operator" };
    case "over":
      return { state: "over", text: "Your session has ended" };
    case "late":
      return { state: "late", text: "No news from the swarm for a moment. Controls are off." };
    case "silent":
      return {
        state: "silent",
        text: isDirect
          ? "Connected, but the swarm is silent. If that lasts, tell the operator."
          : "Connected, but the swarm is silent. Scan its code again; if that does not help, tell the operator.",
      };
    case "unanswered":
      return { state: "unanswered", text: "The swarm is heard, but does not answer. If that lasts, tell the operator." };
    case "live":
      if (held) return { state: "held", text: "Stopped: the operator holds all robots. Controls are off." };
      return { state: "live", text: robots === 1 ? "Live · 1 robot" : `Live · ${robots} robots` };
  }
}

const OFFLINE = {
  network: () => "You are offline: this device has no network. Waiting for it…",
  direct: ({ host }: Where) => `No connection to the swarm at ${host}. Trying again…`,
  answer: () => "No answer from the swarm. Trying again… If that lasts, tell the operator.",
  broker: ({ host }: Where) => `Broker unreachable at ${host}. Trying again… If that lasts, scan the code again.`,
  login: ({ host }: Where) => `Login refused by the broker at ${host}: it wants a password. Tell the operator.`,
} as const;

/** Host and port of a broker's URL, as people say it. */
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
