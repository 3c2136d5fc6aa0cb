// Everything that a peer can get wrong, by the names and reasons of docs/spec/link.md.
//
// A PeerError is expected, counted by its reason and survived: none ever leaves Link. A UsageError is ours to mend.

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

export class MalformedJwe extends PeerError {
  override readonly reason = "malformed_jwe";
  override readonly name = "MalformedJwe";
}

export class NotAuthentic extends PeerError {
  override readonly reason = "not_authentic";
  override readonly name = "NotAuthentic";
}

export class MalformedEnvelope extends PeerError {
  override readonly reason = "malformed_envelope";
  override readonly name = "MalformedEnvelope";
}

/** The timestamp is further from now than the tolerance. The message was authentic: the clock at fault may be ours. */
export class Stale extends PeerError {
  override readonly reason = "stale";
  override readonly name = "Stale";
  /** Sender's timestamp minus our clock, seconds: positive when our clock is behind. */
  readonly skew_s: number;

  constructor(skew_s: number) {
    super(`timestamp is ${skew_s.toFixed(1)} s from our clock`);
    this.skew_s = skew_s;
  }
}

export class Replayed extends PeerError {
  override readonly reason = "replayed";
  override readonly name = "Replayed";
}

export class CacheFull extends PeerError {
  override readonly reason = "cache_full";
  override readonly name = "CacheFull";
}

export class WrongTopic extends PeerError {
  override readonly reason = "wrong_topic";
  override readonly name = "WrongTopic";
}

export class BadPayload extends PeerError {
  override readonly reason = "bad_payload";
  override readonly name = "BadPayload";
}

/** A sealed message was refused: one type whatever went wrong; `cause` says what. */
export class OpenError extends PeerError {
  override readonly name = "OpenError";
  override readonly reason: string;
  override readonly cause: PeerError;

  constructor(cause: PeerError) {
    super(cause.message, { cause });
    this.cause = cause;
    this.reason = cause.reason;
  }

  /** Only when Stale. */
  get skew_s(): number | undefined {
    return this.cause instanceof Stale ? this.cause.skew_s : undefined;
  }
}

/** Not 4 to 64 digits. The message never repeats what was given: it may be a mistyped secret. */
export class BadPin extends UsageError {
  override readonly name = "BadPin";

  constructor() {
    super("the pin is not 4 to 64 digits");
  }
}

/** Not a link from a swarm's QR code. The message never repeats the link: it may hold a pin. */
export class BadQrUrl extends UsageError {
  override readonly name = "BadQrUrl";
}
