// Marks: a colour and a pattern for each robot.

import { afterEach, describe, expect, test, vi } from "vitest";
import { type Area, NO_SWARM, type Point, type Robot } from "../client";
import { MARKED, markOf } from "../map/marks";
import { fitArea } from "../map/projection";
import { drawRobots } from "../map/scene";
import type { Theme } from "../map/theme";

const TWELVE = Array.from({ length: 12 }, (_, number) => markOf(number));
const channels = (colour: string) => [1, 3, 5].map((i) => Number.parseInt(colour.slice(i, i + 2), 16));
/** Of a colour, as WCAG has it. */
function luminance(colour: string): number {
  const [r = 0, g = 0, b = 0] = channels(colour).map((c) => (c <= 10 ? c / 3294.6 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

describe("marks", () => {
  test("the first twelve robots differ in colour, each of them from all others, and in pattern", () => {
    for (const [i, a] of TWELVE.entries()) {
      for (const b of TWELVE.slice(i + 1)) {
        const apart = Math.hypot(...channels(a.colour).map((c, k) => c - (channels(b.colour)[k] ?? 0)));
        expect(apart, `${a.colour} and ${b.colour}`).toBeGreaterThan(60);
        expect(a.pattern).not.toBe(b.pattern);
      }
    }
  });

  test("no two robots have the same mark before there are more robots than marks", () => {
    const all = Array.from({ length: MARKED }, (_, number) => JSON.stringify(markOf(number)));
    expect(new Set(all).size).toBe(144);
  });

  test("a pattern can be seen on its colour", () => {
    for (const { colour, ink } of TWELVE) {
      const [low = 0, high = 0] = [colour, ink].map(luminance).sort((a, b) => a - b);
      expect((high + 0.05) / (low + 0.05), colour).toBeGreaterThan(3);
    }
  });
});

describe("on the map", () => {
  afterEach(() => void vi.unstubAllGlobals());

  const area: Area = { width: 2000, height: 2000 };

  function drawn(marked: boolean, safeMode = false): string[] {
    const filled: string[] = [];
    class Path {
      readonly d: string;
      constructor(d: string) {
        this.d = d;
      }
    }
    vi.stubGlobal("Path2D", Path);
    let colour = "";
    const pen = new Proxy(
      { fill: (path?: Path) => filled.push(path instanceof Path ? path.d : colour) },
      { get: (target, name) => (name === "fill" ? target.fill : () => {}), set: (_, name, value: string) => (name === "fillStyle" && (colour = value), true) },
    );
    const led = { red: 1, green: 200, blue: 3 };
    const robot = { address: "A", number: 5, status: 0, led, waypoints: [], position: { x: 0, y: 0 }, shield: { safeMode, vouchers: [] } };
    const swarm = { ...NO_SWARM, area, robots: new Map([["A", robot as unknown as Robot]]) };
    const scene = { swarm, selected: undefined, draft: [], threshold: 0, cursor: undefined, marked, buttons: 1 };
    const places = new Map<string, Point>([["A", { x: 70, y: 90 }]]);
    drawRobots(pen as unknown as CanvasRenderingContext2D, fitArea(area, 300, 300), { unlit: "grey" } as Theme, scene, places, 0, true);
    return filled;
  }

  test("a robot shows its mark within a rim of its light; stopped it is grey, and in a run only its light shows", () => {
    const { colour, pattern } = markOf(5);
    expect(drawn(true)).toEqual(["rgb(1 200 3)", colour, pattern]);
    expect(drawn(true, true)).toEqual(["grey"]);
    expect(drawn(false)).toEqual(["rgb(1 200 3)"]);
  });
});
