// Errors, with the reasons of docs/spec/session.md.
//
// A PeerError is expected, counted by its reason and tolerated: none leaves a session. A UsageError is a bug of ours.

/** Data from outside is invalid. */
export class PeerError extends Error {
  readonly reason: string = "peer_error";
  override readonly name: string = "PeerError";
}

/** The page, or its user, gave an unusable value. */
export class UsageError extends Error {
  override readonly name: string = "UsageError";
}

export class TooLarge extends PeerError {
  override readonly reason = "too_large";
  override readonly name = "TooLarge";
}

export class NotAuthentic extends PeerError {
  override readonly reason = "not_authentic";
  override readonly name = "NotAuthentic";
}

export class Replayed extends PeerError {
  override readonly reason = "replayed";
  override readonly name = "Replayed";
}

export class BadPayload extends PeerError {
  override readonly reason = "bad_payload";
  override readonly name = "BadPayload";
}
