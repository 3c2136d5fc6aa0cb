// A robot's trail: its places, oldest first.
//
// Two hundred robots add a point each, ten times a second, and a reducer must not modify its state. So successive trails
// share one buffer, of which each sees its own range: appending copies nothing.

/** Longest trail. */
export const TRAIL_POINTS = 1000;

export interface Point {
  readonly x: number;
  readonly y: number;
}

export class Trail {
  static readonly EMPTY = new Trail([], 0, 0);
  // x, y, x, y, …: half the memory of objects.
  readonly #flat: number[];
  readonly #from: number;
  readonly #to: number;

  private constructor(flat: number[], from: number, to: number) {
    this.#flat = flat;
    this.#from = from;
    this.#to = to;
  }

  static of(points: readonly Point[]): Trail {
    const last = points.slice(-TRAIL_POINTS);
    return new Trail(
      last.flatMap(({ x, y }) => [x, y]),
      0,
      last.length,
    );
  }

  get length(): number {
    return this.#to - this.#from;
  }

  x(i: number): number {
    return this.#flat[2 * (this.#from + i)] ?? 0;
  }

  y(i: number): number {
    return this.#flat[2 * (this.#from + i) + 1] ?? 0;
  }

  /** This trail plus one point; without its oldest one if it is full. */
  append({ x, y }: Point): Trail {
    const from = Math.max(this.#from, this.#to + 1 - TRAIL_POINTS);
    // Copied if another trail has already been appended to this one, and once every thousand points to drop old ones.
    const shared = 2 * this.#to === this.#flat.length && from < TRAIL_POINTS;
    const flat = shared ? this.#flat : this.#flat.slice(2 * from, 2 * this.#to);
    flat.push(x, y);
    return shared ? new Trail(flat, from, this.#to + 1) : new Trail(flat, 0, this.#to + 1 - from);
  }
}
