// Turn a held stick into wheel commands, so that a robot that nobody drives stands still.
//
// While held: a command at each change and every 100 ms; on release: exactly one zero. The gateway stops it after 300 ms.

export interface Stick {
  /** -1 left … 1 right. */
  readonly x: number;
  /** -1 back … 1 forward. */
  readonly y: number;
}

export interface Wheels {
  readonly left: number;
  readonly right: number;
}

export const DRIVE_EVERY_MS = 100;
const FULL = 100;
// Dead zone: a thumb that rests in the middle must not move the robot.
const DEAD_ZONE = 0.1;

/** Wheel speeds, whole numbers within ±100, scaled together so that a curve keeps its radius. */
export function wheels({ x, y }: Stick): Wheels {
  if (Math.hypot(x, y) < DEAD_ZONE) return { left: 0, right: 0 };
  const left = y + x;
  const right = y - x;
  const scale = FULL / Math.max(1, Math.abs(left), Math.abs(right));
  // `+ 0` because -0 would show in JSON and in texts.
  return { left: Math.round(left * scale) + 0, right: Math.round(right * scale) + 0 };
}

/** A stick within the unit circle. */
export function clampStick({ x, y }: Stick): Stick {
  const reach = Math.hypot(x, y);
  return reach <= 1 ? { x, y } : { x: x / reach, y: y / reach };
}

const KEYS: Readonly<Record<string, Stick>> = {
  ArrowUp: { x: 0, y: 1 },
  ArrowDown: { x: 0, y: -1 },
  ArrowLeft: { x: -1, y: 0 },
  ArrowRight: { x: 1, y: 0 },
  KeyW: { x: 0, y: 1 },
  KeyS: { x: 0, y: -1 },
  KeyA: { x: -1, y: 0 },
  KeyD: { x: 1, y: 0 },
};
// Keys are on or off: full speed, and a turn that can still be aimed.
const KEY_FORWARD = 0.8;
const KEY_TURN = 0.4;

export function isDriveKey(code: string): boolean {
  return Object.hasOwn(KEYS, code);
}

/** The stick for the held keys (KeyboardEvent.code); undefined when none drives. */
export function stickOfKeys(held: ReadonlySet<string>): Stick | undefined {
  const sticks = [...held].flatMap((code) => (isDriveKey(code) ? [KEYS[code]] : []));
  if (sticks.length === 0) return undefined;
  const sum = (axis: "x" | "y") => Math.sign(sticks.reduce((total, stick) => total + (stick?.[axis] ?? 0), 0));
  return { x: sum("x") * KEY_TURN, y: sum("y") * KEY_FORWARD };
}

/** Drives one robot. */
export class Drive {
  readonly #send: (wheels: Wheels) => void;
  #stick: Stick | undefined;
  #repeating: ReturnType<typeof setInterval> | undefined;

  /** Sent values wait for a slot of the constant rate; only the newest within a slot is sent. */
  constructor(send: (wheels: Wheels) => void) {
    this.#send = send;
  }

  /** The stick is held here until the next hold() or release(). */
  hold(stick: Stick): void {
    this.#stick = stick;
    this.#send(wheels(stick));
    this.#repeating ??= setInterval(() => {
      if (this.#stick) this.#send(wheels(this.#stick));
    }, DRIVE_EVERY_MS);
  }

  /** Stop the robot. No effect if nothing is held. */
  release(): void {
    if (this.#repeating === undefined) return;
    clearInterval(this.#repeating);
    this.#repeating = undefined;
    this.#stick = undefined;
    this.#send({ left: 0, right: 0 });
  }
}
