// What a visitor knows of its own session: whether it is admitted, as what, with which robot, and why not.

import type { EndReason, Reason, Standing } from "./session";

/**
 * joining: on the way, also after a lost connection; here: admitted; over: nothing is tried any more until somebody
 * decides to.
 */
export type Stage = "joining" | "here" | "over";

/** The server's reasons; code: no secret that we have is valid; too_many: tries of room codes, or connections. */
export type OverReason = Extract<EndReason, "removed" | "replaced" | "new_code" | "full"> | "code" | "too_many";

export interface Visit {
  readonly stage: Stage;
  readonly over: OverReason | undefined;
  /** Nickname in use; no two visitors have the same. */
  readonly name: string;
  readonly standing: Standing | undefined;
  /** When the standing came: its `left_ms` counts from then. */
  readonly standingAt_ms: number;
  /** The newest command that was refused. */
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
