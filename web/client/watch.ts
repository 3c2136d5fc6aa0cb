// Watch over a swarm that may fall silent: when to repeat request 0, and what to show the visitor.
//
// Pure: it receives events with their times, and returns due actions.

/**
 * connecting: not connected yet; offline: lost, reconnecting; refused: a login is needed, or another one. In sessions also:
 * no_answer: the server did not answer; waiting: for the operator's approval; over: no more attempts.
 */
export type BrokerState = "connecting" | "online" | "offline" | "refused" | "no_answer" | "waiting" | "over";

/**
 * No update for this time: the shown state is old, and commands may be lost. A gateway sends one every 300 ms at least, and
 * visitors should notice within a second.
 */
const LATE_MS = 800;
/** Shorter if the device reports no network, but not immediate: a broker can run on the device itself. */
const LATE_WITHOUT_NETWORK_MS = 400;
/** After this silence, ask again. */
const SILENCE_MS = 5000;
const ASK_AGAIN_MS = 3000;
// A swarm needs time to answer before it is called silent.
const GRACE_MS = 1500;
const RESYNC_MS = 60_000;
/**
 * Numbered updates reveal gaps; lists of a thousand robots for two hundred visitors, once a minute, would be half of a
 * gateway's work.
 */
const RESYNC_BESIDE_FRAMES_MS = 600_000;
const RESYNC_JITTER = 1 / 6;
/** After a gap every visitor asks: at random times. */
const GAP_JITTER_MS = 500;
/** When a broker returns, all visitors reconnect at once; updates continue meanwhile. */
const RECONNECT_JITTER_MS = 2000;
/**
 * A peer whose updates all look like gaps must not cause a request each time. Nor may requests add to the load of a busy
 * gateway: each one soon after another doubles the time to the next.
 */
const ASK_GAP_MS = 1000;
const ASK_GAP_MOST_MS = 16_000;
const CALM_MS = 30_000;
/** Connecting for longer than this counts as unreachable. */
const PATIENCE_MS = 5000;

export type Health =
  | { readonly state: "connecting"; readonly broker: "away" | "reached" }
  /** network: the device has none. */
  | { readonly state: "offline"; readonly why: "network" | "broker" | "login" | "answer" }
  /** For the operator's approval. */
  | { readonly state: "waiting" }
  /** The session has ended permanently. */
  | { readonly state: "over" }
  /** Updates are late, but not for long. */
  | { readonly state: "late" }
  | { readonly state: "silent" }
  /** Updates arrive, but no request was ever answered: a broker may drop requests or answers. */
  | { readonly state: "unanswered" }
  | { readonly state: "live" };

export class Watch {
  #broker: BrokerState = "connecting";
  #brokerSince_ms: number;
  #heardAt_ms: number | undefined;
  #askedAt_ms = Number.NEGATIVE_INFINITY;
  #askAt_ms = Number.POSITIVE_INFINITY;
  #askGap_ms = ASK_GAP_MS;
  #answered = true;
  #everAnswered = false;
  #openSince_ms = Number.POSITIVE_INFINITY;
  #framed = false;

  constructor(now_ms: number) {
    this.#brokerSince_ms = now_ms;
  }

  /** `chance` is in [0, 1). */
  broker(state: BrokerState, now_ms: number, chance: number): void {
    const again = this.#broker === "offline" || this.#broker === "refused" || this.#broker === "no_answer";
    this.#broker = state;
    this.#brokerSince_ms = now_ms;
    this.#heardAt_ms = undefined;
    // A pending request died with its connection: this plan replaces it.
    this.#answered = true;
    this.#openSince_ms = Number.POSITIVE_INFINITY;
    this.#framed = false;
    this.#askedAt_ms = Number.NEGATIVE_INFINITY;
    this.#askAt_ms = state === "online" ? now_ms + (again ? chance * RECONNECT_JITTER_MS : 0) : Number.POSITIVE_INFINITY;
  }

  /** An authentic, fresh message arrived. */
  heard(now_ms: number): void {
    this.#heardAt_ms = now_ms;
  }

  /** A numbered update arrived: gaps will show from now on. */
  framed(): void {
    this.#framed = true;
  }

  /** Request 0 was answered: no request is open. */
  answered(): void {
    this.#answered = true;
    this.#everAnswered = true;
  }

  /** Updates were missed. `chance` is in [0, 1). */
  missed(now_ms: number, chance: number): void {
    this.#askAt_ms = Math.min(this.#askAt_ms, now_ms + chance * Math.max(GAP_JITTER_MS, this.#askGap_ms / 2));
  }

  /** Whether to send request 0 now; then it counts as sent. `chance` is in [0, 1). */
  due(now_ms: number, chance: number): boolean {
    if (this.#broker !== "online") return false;
    const quietSince_ms = this.#heardAt_ms ?? this.#brokerSince_ms;
    // Updates alone do not list all robots: a lost request is repeated, too.
    const silent = now_ms - quietSince_ms >= SILENCE_MS;
    const since_ms = now_ms - this.#askedAt_ms;
    const again = silent ? since_ms >= ASK_AGAIN_MS : !this.#answered && since_ms >= Math.max(ASK_AGAIN_MS, this.#askGap_ms);
    const planned = now_ms >= this.#askAt_ms && since_ms >= this.#askGap_ms;
    if (!again && !planned) return false;
    this.#askGap_ms = since_ms < CALM_MS ? Math.min(2 * this.#askGap_ms, ASK_GAP_MOST_MS) : ASK_GAP_MS;
    this.#askedAt_ms = now_ms;
    this.#openSince_ms = Math.min(this.#openSince_ms, now_ms);
    this.#answered = false;
    this.#askAt_ms = now_ms + (this.#framed ? RESYNC_BESIDE_FRAMES_MS : RESYNC_MS) * (1 + chance * RESYNC_JITTER);
    return true;
  }

  /** `network`: whether the device reports a network. */
  health(now_ms: number, network = true): Health {
    if (this.#broker === "over") return { state: "over" };
    const quiet_ms = now_ms - (this.#heardAt_ms ?? this.#brokerSince_ms);
    if (!network && quiet_ms >= LATE_WITHOUT_NETWORK_MS) return { state: "offline", why: "network" };
    if (this.#broker === "refused") return { state: "offline", why: "login" };
    if (this.#broker === "offline") return { state: "offline", why: "broker" };
    if (this.#broker === "no_answer") return { state: "offline", why: "answer" };
    if (this.#broker === "waiting") return { state: "waiting" };
    if (this.#broker === "connecting") {
      if (quiet_ms >= PATIENCE_MS) return { state: "offline", why: "broker" };
      return { state: "connecting", broker: "away" };
    }
    if (quiet_ms >= SILENCE_MS + GRACE_MS) return { state: "silent" };
    if (this.#framed && quiet_ms >= LATE_MS) return { state: "late" };
    if (!this.#everAnswered && now_ms - this.#openSince_ms >= SILENCE_MS + GRACE_MS) return { state: "unanswered" };
    return this.#heardAt_ms === undefined ? { state: "connecting", broker: "reached" } : { state: "live" };
  }
}
