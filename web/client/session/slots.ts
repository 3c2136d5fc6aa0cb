// A constant rate: one record in each slot, so that times and sizes do not reveal its kind, such as turn or stop.
//
// Pure, like phalanx/link/session/slots.py.

/** Time between two slots. The gateway stops a robot 300 ms after its last command. */
export const SLOT_MS = 100;
/** A steady command ends after this time unless renewed. */
export const STEADY_MS = 250;
/** During a steady command, others are sent at most once in so many slots, or the wheels would stutter. */
const STEADY_SLOTS = 3;
const WAITING_MAX = 64;

/** A command for a robot, or a request, whose robot is "". */
export interface Saying {
  readonly robot: string;
  readonly name: string;
  /** Encrypts and sends it at this time, so that it refers to the newest update. */
  readonly say: (now_ms: number) => void;
}

/** The records that a visitor sends next. */
export class Slots {
  #steady: { readonly saying: Saying; readonly until_ms: number } | undefined;
  readonly #stops = new Map<string, Saying>();
  readonly #waiting = new Map<string, Saying>();
  #steadyInARow = 0;

  /** Whether a stop waits for its slot. */
  get hasStop(): boolean {
    return this.#stops.size > 0;
  }

  /** Send this in every slot, until it is replaced, stopped or not renewed. */
  hold(saying: Saying, now_ms: number): void {
    this.#stops.delete(saying.robot);
    this.#steady = { saying, until_ms: now_ms + STEADY_MS };
  }

  /** Send this in the next slot, before all else, and drop the robot's waiting commands, which are older. */
  stop(saying: Saying): void {
    if (this.#steady?.saying.robot === saying.robot) this.#steady = undefined;
    for (const [key, waiting] of this.#waiting) if (waiting.robot === saying.robot) this.#waiting.delete(key);
    this.#stops.set(saying.robot, saying);
  }

  /** Send this once. A newer command of the same name replaces a waiting one. False: too many wait. */
  put(saying: Saying): boolean {
    const key = `${saying.robot} ${saying.name}`;
    if (this.#waiting.size >= WAITING_MAX && !this.#waiting.has(key)) return false;
    this.#waiting.set(key, saying);
    return true;
  }

  /** The record of this slot; undefined: none, so send `alive`. */
  take(now_ms: number): Saying | undefined {
    if (this.#steady !== undefined && now_ms >= this.#steady.until_ms) this.#steady = undefined;
    const stop = first(this.#stops);
    if (stop !== undefined) return stop;
    const isTheirs = this.#steady === undefined || this.#steadyInARow >= STEADY_SLOTS - 1;
    const waiting = isTheirs ? first(this.#waiting) : undefined;
    if (waiting !== undefined) {
      this.#steadyInARow = 0;
      return waiting;
    }
    this.#steadyInARow += 1;
    return this.#steady?.saying;
  }

  /** Drop everything: the session is over or lost. A joystick's command must not arrive late. */
  clear(): void {
    this.#steady = undefined;
    this.#stops.clear();
    this.#waiting.clear();
  }
}

/** Remove and return the oldest. */
function first(queue: Map<string, Saying>): Saying | undefined {
  for (const [key, saying] of queue) {
    queue.delete(key);
    return saying;
  }
  return undefined;
}
