// Missions: what pages make of a gateway's words about them, and how they are put for people.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { type Json, NO_SWARM, readDrift, type Swarm, swarmReducer } from "../client";
import { missionWords, walkWords } from "../visitor/mission_words";

const A = "DECAFBAD00000001";
const B = "DECAFBAD00000002";

type Action = Parameters<typeof swarmReducer>[1];
const play = (actions: readonly Action[], from: Swarm = NO_SWARM) => actions.reduce(swarmReducer, from);
const told = (request: number, data: unknown) => ({ kind: "replied", request, data: data as Json, at_ms: 0 }) as const;
const frame = (seq: number, more: object) =>
  ({ kind: "notified", payload: { cmd: 16, data: { seq, ...more } } as Json, at_ms: 0 }) as const;

const robot = (address: string, n: number, name: string, walk: unknown) => ({ address, n, name, walk });
const AREA = { width: 40_000, height: 40_000, walls: 2, mission: ["m1", 5, 4] };
const START = play([
  told(1, AREA),
  told(0, [robot(A, 1, "Ada", ["seeking", 1, 5, ""]), robot(B, 2, "Bo", ["waiting", 0, 5, ""])]),
  told(2, [
    [0, 0, 100, 0],
    [100, 0, 100, 200],
  ]),
  told(3, [[50, 60, "doorway"]]),
]);
const words = (swarm: Swarm, address?: string) => missionWords(swarm, address).split("\n");

describe("missions", () => {
  test("answers tell the building, the mission, what is lit and how far each robot is", () => {
    expect(START.missions).toEqual({
      walls: [
        [0, 0, 100, 0],
        [100, 0, 100, 200],
      ],
      progress: { id: "m1", nodes: 5, left: 4 },
      lit: [{ x: 50, y: 60, type: "doorway" }],
    });
    expect(START.robots.get(A)?.walk).toEqual({ phase: "seeking", decoded: 1, of: 5, why: "", drift: [0, 0, 0] });
    expect(words(START)[0]).toBe("running");
    expect(words(START)[1]).toBe("1 of 5 steps unlocked.");
    expect(words(START)[2]).toContain("4 still secret");
    expect(words(START, A)[3]).toBe("Ada: searching for the next landmark, 1 of 5 steps unlocked");
    expect(words(START, B)[3]).toBe("Bo: waiting to begin");
  });

  test("frames light landmarks, once each, and tell how far robots are", () => {
    const next = play(
      [
        frame(0, { mission: [["m1", 5, 3]], lit: [[70, 80, "room"]], walks: [[1, "seeking", 2, 5, ""]] }),
        frame(1, { lit: [[70, 80, "room"]] }),
        told(3, [
          [50, 60, "doorway"],
          [70, 80, "room"],
        ]),
      ],
      START,
    );
    expect(next.missions?.lit).toEqual([
      { x: 50, y: 60, type: "doorway" },
      { x: 70, y: 80, type: "room" },
    ]);
    expect(next.missions?.progress?.left).toBe(3);
    expect(next.robots.get(A)?.walk?.decoded).toBe(2);
    expect(next.missed).toBe(START.missed);
  });

  test("another mission puts out all lights, and makes the page ask what was decoded before it heard", () => {
    const next = play([frame(0, { mission: [["m2", 9, 8]], lit: [[1, 2, ""]] })], START);
    expect(next.missions).toMatchObject({ progress: { id: "m2", nodes: 9, left: 8 }, lit: [{ x: 1, y: 2, type: "" }] });
    expect(next.missions?.walls).toBe(START.missions?.walls);
    expect(next.missed).toBe(START.missed + 1);
    expect(play([frame(1, { mission: [["m2", 9, 7]] })], next).missed).toBe(next.missed);
  });

  test("robots that are held say why, and the end is told apart from a halt", () => {
    const held = play([frame(0, { walks: [[1, "held", 2, 5, "no way left"]] })], START);
    expect(words(held, A)[3]).toBe("Ada: stopped (no way left), 2 of 5 steps unlocked");
    const halt = play([frame(1, { walks: [[2, "done", 5, 5, ""]], mission: [["m1", 5, 0]] })], held);
    expect(words(halt).slice(0, 3)).toEqual([
      "stopped",
      "All robots have stopped; 1 of 2 completed the mission. 5 of 5 steps unlocked.",
      "All steps are readable now.",
    ]);
    const done = play([frame(2, { walks: [[1, "done", 5, 5, ""]] })], halt);
    expect(words(done).slice(0, 2)).toEqual(["done", "Mission completed: 5 of 5 steps unlocked, all robots have stopped."]);
    expect(walkWords({ phase: "returning", decoded: 2, of: 5, why: "blocked", drift: [0, 0, 0] })).toBe(
      "did not find it (blocked): going back to its last landmark, 2 of 5 steps unlocked",
    );
  });

  test("what a robot has learnt of its wheels is read, and no visitor has to read it", () => {
    const next = play([frame(0, { walks: [[1, "seeking", 2, 5, "", [29, -48, 12]]] })], START);
    expect(next.robots.get(A)?.walk?.drift).toEqual([29, -48, 12]);
    expect(words(next, A)).toHaveLength(4);
    expect(readDrift(["much", 1e9, 7])).toEqual([0, 0, 7]);
  });

  test("before the first mission robots wait; without missions there are no such words", () => {
    expect(words(play([told(1, { ...AREA, mission: null })]))[0]).toBe("waiting");
    expect(missionWords(play([told(1, { width: 2000, height: 2000 })]), undefined)).toBe("none");
    expect(play([told(2, [[0, 0, 1, 1]]), told(3, [[0, 0, ""]])]).missions).toBeUndefined();
  });

  test("nonsense never throws, and what is kept stays small", () => {
    const row = fc.oneof(fc.jsonValue(), fc.array(fc.oneof(fc.integer(), fc.double(), fc.string()), { maxLength: 6 }));
    const rows = fc.oneof(fc.jsonValue(), fc.array(row, { maxLength: 8 }));
    fc.assert(
      fc.property(rows, rows, rows, fc.jsonValue(), (mission, lit, walks, answer) => {
        const swarm = play(
          [told(1, { ...AREA, mission: answer }), told(2, answer), told(3, lit), frame(0, { mission, lit, walks })],
          START,
        );
        for (const [ax, ay, bx, by] of swarm.missions?.walls ?? [])
          for (const value of [ax, ay, bx, by]) expect(Number.isFinite(value)).toBe(true);
        for (const { x, y } of swarm.missions?.lit ?? []) expect(Number.isFinite(x + y)).toBe(true);
        expect(() => missionWords(swarm, A)).not.toThrow();
      }),
    );
    const many = Array.from({ length: 30_000 }, (_, i) => [i, 0, i, 1]);
    const swarm = play([told(2, many), told(3, many), frame(0, { lit: many.map(([x]) => [x, 7, "qr"]) })], START);
    expect(swarm.missions?.walls).toHaveLength(20_000);
    expect(swarm.missions?.lit.length).toBeLessThanOrEqual(5000);
  });
});
