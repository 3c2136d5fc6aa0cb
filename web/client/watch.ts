// Watching over a swarm that may fall silent: when to ask request 0 again, and what to tell the visitor.
//
// Pure: told what happened and when, it says what is due.

/**
 * connecting: not yet heard of; offline: lost, and being tried again; refused: it wants a login, or another one. Of a
 * session also: no_answer: the server said nothing; waiting: for the operator's approval; over: tried no longer.
 */
export type BrokerState = "connecting" | "online" | "offline" | "refused" | "no_answer" | "waiting" | "over";

/**
 * No frame for so long: what is shown is old, and what is said may be lost. A gateway sends one every 300 ms at least, and
 * its visitors shall know within a second that it does not.
 */
const LATE_MS = 800;
/** A device that says that it has no network is believed sooner; but not at once, for a broker may be on itself. */
const LATE_WITHOUT_NETWORK_MS = 400;
/** Nothing heard for so long: ask again. */
const SILENCE_MS = 5000;
const ASK_AGAIN_MS = 3000;
// A swarm must have had the time to answer before it is called silent.
const GRACE_MS = 1500;
const RESYNC_MS = 60_000;
/**
 * Numbered frames show what is missing; and lists of a thousand robots for two hundred visitors, once a minute, would be
 * half of a gateway's work.
 */
const RESYNC_BESIDE_FRAMES_MS = 600_000;
const RESYNC_JITTER = 1 / 6;
/** After a gap everybody asks: not all at once. */
const GAP_JITTER_MS = 500;
/** A broker that comes back finds everybody waiting; the frames go on meanwhile. */
const RECONNECT_JITTER_MS = 2000;
/**
 * A peer that makes every frame look like a gap must not make us ask at every frame. Nor must a gateway that is too busy to
 * send every frame get busier by everybody's questions: each that follows another soon doubles the time to the next.
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
  /** The session has ended for good. */
  | { readonly state: "over" }
  /** Frames have stopped coming, but not for long. */
  | { readonly state: "late" }
  | { readonly state: "silent" }
  /** Heard, but no question was ever answered: a broker may keep what we say, or what we are told, to itself. */
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
    // A question of before died with its connection: what is planned here takes its place.
    this.#answered = true;
    this.#openSince_ms = Number.POSITIVE_INFINITY;
    this.#framed = false;
    this.#askedAt_ms = Number.NEGATIVE_INFINITY;
    this.#askAt_ms = state === "online" ? now_ms + (again ? chance * RECONNECT_JITTER_MS : 0) : Number.POSITIVE_INFINITY;
  }

  /** An authentic, fresh message came. */
  heard(now_ms: number): void {
    this.#heardAt_ms = now_ms;
  }

  /** A numbered frame came: whatever is missed from now on will show. */
  framed(): void {
    this.#framed = true;
  }

  /** Request 0 was answered: no question is open. */
  answered(): void {
    this.#answered = true;
    this.#everAnswered = true;
  }

  /** Something was missed. `chance` is in [0, 1). */
  missed(now_ms: number, chance: number): void {
    this.#askAt_ms = Math.min(this.#askAt_ms, now_ms + chance * Math.max(GAP_JITTER_MS, this.#askGap_ms / 2));
  }

  /** Whether to ask request 0 now; then it counts as asked. `chance` is in [0, 1). */
  due(now_ms: number, chance: number): boolean {
    if (this.#broker !== "online") return false;
    const quietSince_ms = this.#heardAt_ms ?? this.#brokerSince_ms;
    // Frames alone do not tell who is there: a question that was lost is asked again, too.
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

  /** `network`: whether the device says that it has any. */
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
