// The map's fingers and zoom, and its names, without a page.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import type { Area, Point, Robot } from "../client";
import { Gesture } from "../map/gesture";
import { Names } from "../map/names";
import { fitArea, toArea, toScreen, zoomed } from "../map/projection";
import { drawRobots, robotRadius, type Scene } from "../map/scene";
import type { Theme } from "../map/theme";

const MM: Area = { width: 3000, height: 2000 };
const [WIDTH, HEIGHT] = [360, 340];
const NOWHERE: Point = { x: 0, y: 0 };

describe("zoom", () => {
  const times = fc.double({ min: 1.5, max: 6, noNaN: true });
  const across = fc.double({ min: 0.2, max: 0.8, noNaN: true });

  test("what is under the fingers stays under them, unless the map would leave its frame", () => {
    fc.assert(
      fc.property(times, across, across, (factor, fx, fy) => {
        const whole = fitArea(MM, WIDTH, HEIGHT);
        const under = { x: MM.width * fx, y: MM.height * fy };
        const around = toScreen(whole, under);
        const zoom = zoomed(whole, WIDTH, HEIGHT, { factor, around, by: NOWHERE });
        expect(zoom?.times).toBeCloseTo(factor, 6);
        const p = fitArea(MM, WIDTH, HEIGHT, zoom);
        const after = toScreen(p, under);
        const edges = [p.left, p.left + MM.width * p.scale - WIDTH, p.top, p.top + MM.height * p.scale - HEIGHT];
        if (edges.some((edge) => Math.abs(Math.abs(edge) - 12) < 1e-6) || MM.height * p.scale < HEIGHT - 24) return;
        expect(Math.hypot(after.x - around.x, after.y - around.y)).toBeLessThan(1e-6);
      }),
    );
  });

  test("no gesture shows more emptiness than the margin, and a tap still means the place that is shown", () => {
    const far = fc.double({ min: -2000, max: 2000, noNaN: true });
    fc.assert(
      fc.property(times, far, far, across, across, (factor, dx, dy, fx, fy) => {
        let p = fitArea(MM, WIDTH, HEIGHT);
        const first = zoomed(p, WIDTH, HEIGHT, { factor, around: { x: WIDTH / 2, y: HEIGHT / 2 }, by: NOWHERE });
        p = fitArea(MM, WIDTH, HEIGHT, first);
        p = fitArea(MM, WIDTH, HEIGHT, zoomed(p, WIDTH, HEIGHT, { factor: 1, around: NOWHERE, by: { x: dx, y: dy } }));
        expect(p.left).toBeLessThan(12 + 1e-6);
        expect(p.left + MM.width * p.scale).toBeGreaterThan(WIDTH - 12 - 1e-6);
        const place = { x: Math.round(MM.width * fx), y: Math.round(MM.height * fy) };
        expect(toArea(p, toScreen(p, place))).toEqual(place);
      }),
    );
  });

  test("smaller than the whole is the whole, and larger than twelve times is twelve times", () => {
    const whole = fitArea(MM, WIDTH, HEIGHT);
    const by = (factor: number) => zoomed(whole, WIDTH, HEIGHT, { factor, around: NOWHERE, by: NOWHERE });
    expect(by(0.5)).toBeUndefined();
    expect(by(100)?.times).toBe(12);
  });
});

describe("a route that is being tapped together", () => {
  test("has its points over the robots that stand there, and under the one that shall drive it", () => {
    const there: Point = { x: 900, y: 700 };
    const robots = new Map(["mine", "other"].map((address) => [address, { address, position: there } as Robot]));
    const swarm = { robots, area: MM, audits: [] };
    const scene = { swarm, selected: "mine", draft: [there], threshold: 0 } as unknown as Scene;
    const p = fitArea(MM, WIDTH, HEIGHT);
    const radii: number[] = [];
    const arc = (_x: number, _y: number, radius: number) => radii.push(radius);
    const pen = new Proxy({}, { get: (_, name) => (name === "arc" ? arc : () => {}) });
    const places = new Map([...robots.keys()].map((address) => [address, toScreen(p, there)]));
    drawRobots(pen as CanvasRenderingContext2D, p, {} as Theme, scene, places, 0, true);
    const [other, number, mine] = [robotRadius(p, 2), 8, robotRadius(p, 2) + 1];
    expect(radii.filter((radius) => [other, number, mine].includes(radius))).toEqual([other, number, mine]);
  });
});

describe("fingers", () => {
  test("one that slips a little taps, where it came down", () => {
    const gesture = new Gesture();
    gesture.down(1, { x: 50, y: 50 });
    expect(gesture.move(1, { x: 58, y: 50 })).toBeUndefined();
    expect(gesture.up(1)).toEqual({ x: 50, y: 50 });
  });

  test("one that goes further moves the map, and taps nothing", () => {
    const gesture = new Gesture();
    gesture.down(1, { x: 50, y: 50 });
    expect(gesture.move(1, { x: 80, y: 50 })).toEqual({ factor: 1, around: { x: 50, y: 50 }, by: { x: 30, y: 0 } });
    expect(gesture.up(1)).toBeUndefined();
  });

  test("two pinch, and neither of them taps", () => {
    const gesture = new Gesture();
    gesture.down(1, { x: 100, y: 100 });
    gesture.down(2, { x: 200, y: 100 });
    expect(gesture.move(2, { x: 300, y: 100 })).toEqual({ factor: 2, around: { x: 150, y: 100 }, by: { x: 50, y: 0 } });
    expect([gesture.up(1), gesture.up(2)]).toEqual([undefined, undefined]);
    gesture.down(3, { x: 5, y: 5 });
    expect(gesture.up(3)).toEqual({ x: 5, y: 5 });
  });

  test("what the browser takes away is forgotten", () => {
    const gesture = new Gesture();
    gesture.down(1, NOWHERE);
    gesture.cancel();
    expect([gesture.move(1, { x: 99, y: 0 }), gesture.up(1)]).toEqual([undefined, undefined]);
  });
});

describe("names", () => {
  const drawn: { name: string; x: number; y: number }[] = [];
  const pen = {
    measureText: (name: string) => ({ width: 7 * name.length }),
    strokeText: () => {},
    fillText: (name: string, x: number, y: number) => drawn.push({ name, x, y }),
  } as unknown as CanvasRenderingContext2D;
  const room = { width: WIDTH, height: HEIGHT, buttons: 2 };
  const robot = (i: number) => ({ address: `A${i}`, name: `Name${i}`, drivers: [] as readonly string[] }) as Robot;

  function draw(at: readonly Point[], selected?: string, names = new Names()) {
    drawn.length = 0;
    const places = new Map(at.map((point, i) => [`A${i}`, point]));
    const p = fitArea(MM, WIDTH, HEIGHT);
    names.draw(pen, p, {} as Theme, at.map((_, i) => robot(i)), places, 8, selected, room);
    return drawn.map(({ name }) => name);
  }

  test("none lies on another, none on a robot, wherever a hundred of them stand", () => {
    const place = fc.record({ x: fc.integer({ min: 20, max: 340 }), y: fc.integer({ min: 60, max: 280 }) });
    fc.assert(
      fc.property(fc.array(place, { minLength: 100, maxLength: 100 }), (at) => {
        draw(at);
        const boxes = drawn.map(({ name, x, y }) => {
          const half = 3.5 * name.length + 2; // and room, or two would read as one
          return [x - half, y - 1, x + half, y + 14] as const;
        });
        boxes.forEach(([left, top, right, bottom], i) => {
          for (const [l, t, r, b] of boxes.slice(i + 1)) expect(left < r && l < right && top < b && t < bottom).toBe(false);
          for (const { x, y } of at) expect(left < x + 8 && x - 8 < right && top < y + 8 && y - 8 < bottom).toBe(false);
        });
      }),
      { numRuns: 3 },
    );
  });

  test("none is half under a button", () => {
    const top = HEIGHT - 2 * 44;
    expect(draw([{ x: WIDTH - 50, y: top - 12 }])).toEqual(["Name0"]);
    expect(drawn[0]?.y, "above it, where below is a button").toBeLessThan(top - 12);
    expect(draw([{ x: WIDTH - 50, y: top + 13 }])).toEqual([]);
  });

  test("the chosen robot's is always there, and who has a name keeps it", () => {
    const heap = Array.from({ length: 20 }, (_, i) => ({ x: 180 + i, y: 150 }));
    expect(draw(heap, "A7")).toContain("Name7");
    const names = new Names();
    const [first] = draw([{ x: 100, y: 150 }, { x: 300, y: 150 }], undefined, names);
    expect(first).toBe("Name0");
    const near = [{ x: 290, y: 150 }, { x: 300, y: 150 }];
    expect(draw(near, undefined, names)[0]).toBe("Name0");
  });

  test("where thousands are in sight nobody is named but the chosen one", () => {
    const many = Array.from({ length: 300 }, (_, i) => ({ x: 20 + (i % 20) * 16, y: 70 + Math.floor(i / 20) * 14 }));
    expect(draw(many, "A9")).toEqual(["Name9"]);
  });
});
