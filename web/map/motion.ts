// Interpolate robots' places between updates: places arrive ten times a second, screens are drawn sixty times.

import type { Point } from "../client";

interface Glide {
  x: number;
  y: number;
  toX: number;
  toY: number;
}

/** Time in which a robot covers two thirds of the distance to its reported place. */
const EASE_MS = 70;
const ARRIVED_PX = 0.25;
/** A longer step is a jump: the robot was carried, or the map was rotated. */
const JUMP_PX = 60;

export class Motion {
  readonly #glides = new Map<string, Glide>();

  /** Set robots' places on the screen. Robots that are missing are removed. */
  aim(places: ReadonlyMap<string, Point>, still: boolean): void {
    for (const address of this.#glides.keys()) if (!places.has(address)) this.#glides.delete(address);
    for (const [address, { x, y }] of places) {
      const glide = this.#glides.get(address);
      if (!glide || still || Math.hypot(x - glide.x, y - glide.y) > JUMP_PX) {
        this.#glides.set(address, { x, y, toX: x, toY: y });
      } else {
        glide.toX = x;
        glide.toY = y;
      }
    }
  }

  /** Advance by `dt_ms`; false once all have arrived. */
  advance(dt_ms: number): boolean {
    const share = 1 - Math.exp(-dt_ms / EASE_MS);
    let moving = false;
    for (const glide of this.#glides.values()) {
      const dx = glide.toX - glide.x;
      const dy = glide.toY - glide.y;
      if (Math.abs(dx) < ARRIVED_PX && Math.abs(dy) < ARRIVED_PX) {
        glide.x = glide.toX;
        glide.y = glide.toY;
        continue;
      }
      glide.x += dx * share;
      glide.y += dy * share;
      moving = true;
    }
    return moving;
  }

  get places(): ReadonlyMap<string, Point> {
    return this.#glides;
  }
}
