// The state of a visitor's own session: admission, role, robot, and refusals.

import type { EndReason, Reason, Standing } from "./session";

/**
 * joining: connecting, also after a lost connection; here: admitted; over: no more attempts until the visitor decides
 * to retry.
 */
export type Stage = "joining" | "here" | "over";

/** The server's reasons; code: no known secret is valid; too_many: attempts with room codes, or connections. */
export type OverReason = Extract<EndReason, "removed" | "replaced" | "new_code" | "full"> | "code" | "too_many";

export interface Visit {
  readonly stage: Stage;
  readonly over: OverReason | undefined;
  /** Nickname in use, unique among visitors. */
  readonly name: string;
  readonly standing: Standing | undefined;
  /** When the standing arrived: its `left_ms` counts from then. */
  readonly standingAt_ms: number;
  /** The newest refused command. */
  readonly refused: { readonly reason: Reason; readonly at_ms: number } | undefined;
}

export const NO_VISIT: Visit = {
  stage: "joining",
  over: undefined,
  name: "",
  standing: undefined,
  standingAt_ms: 0,
  refused: undefined,
};
