// A constant rate: one record in each slot, whatever is said, so that times and sizes do not tell a turn from a stop.
//
// Pure. A command waits for its slot, and names the newest update only when it is sent.

/** Between two slots. The gateway stops a robot 300 ms after its last command. */
export const SLOT_MS = 100;
/** What is steady ends by itself, should whoever renews it fall silent. */
export const STEADY_MS = 250;
/** Other commands while something is steady: at most one in so many slots, or the wheels would stutter. */
const STEADY_SLOTS = 3;
const WAITING_MAX = 64;

export interface Command {
  readonly robot: string;
  readonly name: string;
  readonly payload: Uint8Array;
  readonly stop: boolean;
  /** A request in place of a command: sends it when its slot has come. */
  readonly ask?: () => void;
}

/** What one visitor says next. */
export class Slots {
  #steady: { readonly command: Command; readonly until_ms: number } | undefined;
  readonly #stops = new Map<string, Command>();
  readonly #waiting = new Map<string, Command>();
  #steadyInARow = 0;

  /** Whether a stop waits for its slot. */
  get hasStop(): boolean {
    return this.#stops.size > 0;
  }

  /** Say this in every slot, until it is replaced, stopped or not renewed. */
  hold(command: Command, now_ms: number): void {
    this.#stops.delete(command.robot);
    this.#steady = { command, until_ms: now_ms + STEADY_MS };
  }

  /** Say this in the next slot, before all else, and forget the robot's commands that wait: they came before it. */
  stop(command: Command): void {
    if (this.#steady?.command.robot === command.robot) this.#steady = undefined;
    for (const [key, waiting] of this.#waiting) if (waiting.robot === command.robot) this.#waiting.delete(key);
    this.#stops.set(command.robot, command);
  }

  /** Say this once. A newer command of the same name takes the place of one that waits. False: too many wait. */
  put(command: Command): boolean {
    const key = `${command.robot} ${command.name}`;
    if (this.#waiting.size >= WAITING_MAX && !this.#waiting.has(key)) return false;
    this.#waiting.set(key, command);
    return true;
  }

  /** What this slot's record says; undefined: nothing, so that it is `alive`. */
  take(now_ms: number): Command | undefined {
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
    return this.#steady?.command;
  }

  /** Forget all: the session is over, or was lost. A joystick's command must not arrive late. */
  clear(): void {
    this.#steady = undefined;
    this.#stops.clear();
    this.#waiting.clear();
  }
}

/** Takes out the oldest. */
function first(queue: Map<string, Command>): Command | undefined {
  for (const [key, command] of queue) {
    queue.delete(key);
    return command;
  }
  return undefined;
}
