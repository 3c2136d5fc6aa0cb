// Errors of sessions, beside those in core: each is counted by its reason, and tolerated.

import { PeerError, UsageError } from "../core/errors";

/** A message that its sender may not send now. */
export class Unexpected extends PeerError {
  override readonly reason = "unexpected";
  override readonly name = "Unexpected";
}

/** An update under a key that this client does not have. */
export class UnknownEpoch extends PeerError {
  override readonly reason = "unknown_epoch";
  override readonly name = "UnknownEpoch";
}

/** Not the content of a swarm's QR code or screen. The message never repeats it: it may be a mistyped secret. */
export class BadInvitation extends UsageError {
  override readonly name = "BadInvitation";
}

/** Why a command or request was refused. */
export const REASONS = ["", "late", "not_allowed", "busy", "too_many", "bad", "unknown", "held", "failed"] as const;
/** Why a session is over. */
export const ENDS = ["", "removed", "replaced", "new_code", "old_keys", "closing", "full", "not_admitted"] as const;
export type Reason = Exclude<(typeof REASONS)[number], "">;
export type EndReason = Exclude<(typeof ENDS)[number], "">;
