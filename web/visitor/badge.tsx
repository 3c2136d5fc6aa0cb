// The badge: one line that says whether all is well, and if not, what is wrong and what to do.

import type { Health } from "../client";

export type BadgeState = Health["state"] | "held" | "nocode";

interface Words {
  readonly state: BadgeState;
  readonly text: string;
}

/** Plain words for the health of the link. `host` is the broker's; `held`: the operator stopped all; `named`: we said a login. */
export function badgeWords(health: Health, host: string, robots: number, held = false, named = false): Words {
  switch (health.state) {
    case "connecting":
      return {
        state: "connecting",
        text: health.broker === "away" ? "Connecting to the broker…" : "Looking for the swarm…",
      };
    case "offline":
      return { state: "offline", text: OFFLINE[health.why](host, named) };
    case "late":
      return { state: "late", text: "No news from the swarm for a moment. Controls are off." };
    case "silent":
      return {
        state: "silent",
        text: "Connected, but the swarm is silent. Scan its code again; if that does not help, tell the operator.",
      };
    case "unanswered":
      return { state: "unanswered", text: "The swarm is heard, but does not answer. If that lasts, tell the operator." };
    case "clock":
      return { state: "clock", text: `Your clock is ${duration(health.skew_s)}: set it to automatic.` };
    case "live":
      if (held) return { state: "held", text: "Stopped: the operator holds all robots. Controls are off." };
      return { state: "live", text: robots === 1 ? "Live · 1 robot" : `Live · ${robots} robots` };
  }
}

const OFFLINE = {
  network: () => "You are offline: this device has no network. Waiting for it…",
  broker: (host: string) => `Broker unreachable at ${host}. Trying again… If that lasts, scan the code again.`,
  login: (host: string, named: boolean) =>
    named
      ? `Login refused: name or password is wrong for the broker at ${host}. Tell the operator.`
      : `Login refused by the broker at ${host}: it wants a password. Tell the operator.`,
} as const;

/** "31 s behind", "2 min ahead": how our clock differs, given how far the swarm's is ahead of it. */
export function duration(skew_s: number): string {
  const off = Math.abs(skew_s);
  const [amount, unit] =
    off < 120
      ? [off, "s"]
      : off < 7200
        ? [off / 60, "min"]
        : off < 172_800
          ? [off / 3600, "h"]
          : [off / 86_400, "days"];
  return `${Math.round(amount)} ${unit} ${skew_s > 0 ? "behind" : "ahead"}`;
}

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
