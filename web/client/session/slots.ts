// A constant rate: one record in each slot, whatever is said, so that times and sizes do not tell a turn from a stop.
//
// Pure, as phalanx/link/session/slots.py is.

/** Between two slots. The gateway stops a robot 300 ms after its last command. */
export const SLOT_MS = 100;
/** What is steady ends by itself, should whoever renews it fall silent. */
export const STEADY_MS = 250;
/** Other commands while something is steady: at most one in so many slots, or the wheels would stutter. */
const STEADY_SLOTS = 3;
const WAITING_MAX = 64;

/** A command for a robot, or a request, whose robot is "". */
export interface Saying {
  readonly robot: string;
  readonly name: string;
  /** Seals it at this time, and sends it: so it names the newest update. */
  readonly say: (now_ms: number) => void;
}

/** What one visitor says next. */
export class Slots {
  #steady: { readonly saying: Saying; readonly until_ms: number } | undefined;
  readonly #stops = new Map<string, Saying>();
  readonly #waiting = new Map<string, Saying>();
  #steadyInARow = 0;

  /** Whether a stop waits for its slot. */
  get hasStop(): boolean {
    return this.#stops.size > 0;
  }

  /** Say this in every slot, until it is replaced, stopped or not renewed. */
  hold(saying: Saying, now_ms: number): void {
    this.#stops.delete(saying.robot);
    this.#steady = { saying, until_ms: now_ms + STEADY_MS };
  }

  /** Say this in the next slot, before all else, and forget the robot's commands that wait: they came before it. */
  stop(saying: Saying): void {
    if (this.#steady?.saying.robot === saying.robot) this.#steady = undefined;
    for (const [key, waiting] of this.#waiting) if (waiting.robot === saying.robot) this.#waiting.delete(key);
    this.#stops.set(saying.robot, saying);
  }

  /** Say this once. A newer command of the same name takes the place of one that waits. False: too many wait. */
  put(saying: Saying): boolean {
    const key = `${saying.robot} ${saying.name}`;
    if (this.#waiting.size >= WAITING_MAX && !this.#waiting.has(key)) return false;
    this.#waiting.set(key, saying);
    return true;
  }

  /** What this slot's record says; undefined: nothing, so that it is `alive`. */
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

  /** Forget all: the session is over, or was lost. A joystick's command must not arrive late. */
  clear(): void {
    this.#steady = undefined;
    this.#stops.clear();
    this.#waiting.clear();
  }
}

/** Takes out the oldest. */
function first(queue: Map<string, Saying>): Saying | undefined {
  for (const [key, saying] of queue) {
    queue.delete(key);
    return saying;
  }
  return undefined;
}
