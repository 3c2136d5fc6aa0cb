// Touch gestures on the map: one finger taps, or moves an enlarged map; two fingers zoom.

import type { Point } from "../client";

/** A finger that moved further did not tap. */
const TAP_SLIP_PX = 12;

/** A change of the map: zoom by a factor around a place, and move. In pixels. */
export interface Pinch {
  readonly factor: number;
  readonly around: Point;
  readonly by: Point;
}

export class Gesture {
  readonly #fingers = new Map<number, Point>();
  #began: Point | undefined;

  down(id: number, at: Point): void {
    // A gesture with a second finger is not a tap.
    this.#began = this.#fingers.size === 0 ? at : undefined;
    this.#fingers.set(id, at);
  }

  move(id: number, at: Point): Pinch | undefined {
    const from = this.#fingers.get(id);
    if (!from) return undefined;
    if (this.#began && distance(this.#began, at) <= TAP_SLIP_PX) return undefined;
    this.#began = undefined;
    const other = [...this.#fingers].find(([which]) => which !== id)?.[1];
    this.#fingers.set(id, at);
    if (!other) return { factor: 1, around: from, by: { x: at.x - from.x, y: at.y - from.y } };
    const [before, after] = [middle(from, other), middle(at, other)];
    return {
      factor: distance(at, other) / Math.max(distance(from, other), 1),
      around: before,
      by: { x: after.x - before.x, y: after.y - before.y },
    };
  }

  /** Return the place of a tap, if it was one. */
  up(id: number): Point | undefined {
    const tapped = this.#fingers.delete(id) && this.#fingers.size === 0 ? this.#began : undefined;
    this.#began = undefined;
    return tapped;
  }

  cancel(): void {
    this.#fingers.clear();
    this.#began = undefined;
  }
}

function distance(a: Point, b: Point): number {
  return Math.hypot(a.x - b.x, a.y - b.y);
}

function middle(a: Point, b: Point): Point {
  return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
}
