// What a peer can get wrong, by the reasons of docs/spec/session.md.
//
// A PeerError is expected, counted by its reason and survived: none ever leaves a session. A UsageError is ours to mend.

/** Bytes from outside are wrong. */
export class PeerError extends Error {
  readonly reason: string = "peer_error";
  override readonly name: string = "PeerError";
}

/** We, or the person at the page, gave a value that cannot be used. */
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
