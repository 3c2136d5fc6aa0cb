// What visitors are told beside the map: who else drives, who arrived, who was stopped.

import { describe, expect, test } from "vitest";
import { driversOf, type Json, NO_SWARM, type Swarm, swarmReducer } from "../client";
import { workWords } from "../map/work_words";
import { newsOf } from "../visitor/news";
import { shieldWords } from "../visitor/shield_words";

const A = "DECAFBAD00000001";
const B = "DECAFBAD00000002";

let seq = 0;
const framed = (swarm: Swarm, more: object, at_ms: number): Swarm => {
  seq += 1;
  return swarmReducer(swarm, { kind: "notified", payload: { cmd: 16, data: { seq, ...more } } as Json, at_ms });
};

const POINTS = [
  { x: 0, y: 0, z: 0 },
  { x: 500, y: 0, z: 0 },
];

function swarmAt(x: number, more: object = {}): Swarm {
  const robot = { address: A, n: 1, name: "Ada", lh2_position: { x, y: 0, z: 0 }, waypoints_threshold: 40, ...more };
  const told = swarmReducer(NO_SWARM, {
    kind: "replied",
    request: 0,
    data: [robot, { address: B, n: 2, name: "Bo" }] as unknown as Json,
    at_ms: 0,
  });
  return swarmReducer(told, {
    kind: "replied",
    request: 1,
    data: { width: 2000, height: 2000, tokens_needed: 2, t_val_ms: 10_000 },
    at_ms: 0,
  });
}

describe("who else drives", () => {
  test("all but ourselves are counted, also those who give no name, until others are told", () => {
    let swarm = framed(swarmAt(0), { drivers: [[1, ["me", "you", ""]], [2, ["me"]]] }, 1000);
    expect([A, B, undefined].map((robot) => driversOf(swarm, robot, "me").length)).toEqual([2, 0, 0]);
    swarm = framed(swarm, {}, 60_000);
    expect(driversOf(swarm, A, "me")).toHaveLength(2);
    swarm = framed(swarm, { drivers: [[1, []]] }, 60_100);
    expect(driversOf(swarm, A, "me")).toEqual([]);
  });

  test("a list of robots says who drives them", () => {
    const data: Json = [{ address: A, n: 1, drivers: ["you"] }, { address: B, n: 2 }];
    const before = framed(swarmAt(0), { drivers: [[2, ["me"]]] }, 1000);
    const swarm = swarmReducer(before, { kind: "replied", request: 0, data, at_ms: 1100 });
    expect([A, B].map((robot) => driversOf(swarm, robot, ""))).toEqual([["you"], []]);
  });

  test("whatever a peer says, nothing is thrown, and nothing grows without end", () => {
    const words = [null, [], [1], [1, 2], [99, ["x"]], [1, [3, null, "y".repeat(1000)]], [2, Array(1000).fill("z")]];
    const swarm = framed(swarmAt(0), { drivers: words }, 1000);
    expect(driversOf(swarm, A, "me").map((name) => name.length)).toEqual([0, 0, 32]);
    expect(driversOf(swarm, B, "me")).toHaveLength(4);
  });
});

describe("a swarm's own work", () => {
  const told = { work: [["patrol", 86.6, "% watched", 120]], things: [[[10, 20], [30, 40]]] };

  test("its score stays until another is told, and so do its things", () => {
    expect(swarmAt(0).work).toBeUndefined();
    let { work } = framed(swarmAt(0), told, 1000);
    expect(work && workWords(work)).toBe("patrol: 87\u202f% watched, last 2 min");
    expect(work?.things).toEqual([{ x: 10, y: 20 }, { x: 30, y: 40 }]);
    const swarm = framed(framed(swarmAt(0), told, 1000), { work: [["patrol", 3, "deliveries", 30]] }, 1100);
    ({ work } = swarm);
    expect(work && workWords(work)).toBe("patrol: 3 deliveries, last 30 s");
    expect(work?.things).toHaveLength(2);
    ({ work } = framed(swarm, { work: [["perimeter", null, "% caught", 9]] }, 1150));
    expect(work && workWords(work)).toBe("perimeter: nothing to count yet");
    expect(framed(swarm, { things: [[]] }, 1200).work?.things).toEqual([]);
  });

  test("whatever a peer says, nothing is thrown, and nothing grows without end", () => {
    for (const work of [null, 1, [null], [[1, 2]], [["x", "y", "z", 1]], [["x", 1e99, "z", 1]], [["x", 1, "z", 0]]]) {
      expect(framed(swarmAt(0), { work }, 1000).work).toBeUndefined();
    }
    const things = [[null, [], [1], ["a", 2], [1e99, 0], ...Array<[number, number]>(100).fill([1, 2])]];
    expect(framed(swarmAt(0), { ...told, things }, 1000).work?.things).toHaveLength(27);
    const { work } = framed(swarmAt(0), { work: [["x".repeat(1000), 1, "z".repeat(1000), 1]] }, 1000);
    expect(work && workWords(work).length).toBeLessThan(100);
  });
});

describe("news", () => {
  test("a robot whose route ends at its end has arrived; elsewhere it was only stopped", () => {
    const [far, near] = [swarmAt(100, { waypoints: POINTS }), swarmAt(470, { waypoints: POINTS })];
    const ended = (swarm: Swarm) => framed(swarm, { routes: [[1, 0, 0, 1, ""]] }, 100);
    expect(newsOf(near, ended(near), A, POINTS[1])).toBe("Ada has arrived");
    expect(newsOf(far, ended(far), A, POINTS[1])).toBeUndefined();
    expect(newsOf(near, framed(near, {}, 100), A, POINTS[1])).toBeUndefined();
  });

  test("a robot that goes by itself does not arrive, and one that goes on by itself has arrived", () => {
    const [near, on] = [swarmAt(470, { waypoints: POINTS }), swarmAt(470, { waypoints: [POINTS[1], { x: 900, y: 0, z: 0 }] })];
    expect(newsOf(near, swarmAt(470), A)).toBeUndefined();
    expect(newsOf(on, near, A, POINTS[1]), "it was just sent").toBeUndefined();
    expect(newsOf(on, swarmAt(470), A, POINTS[1]), "it has not set out").toBeUndefined();
    expect(newsOf(near, on, A, POINTS[1])).toBe("Ada has arrived");
  });

  test("a robot that goes into Safe Mode was stopped; one that was already is no news", () => {
    const alive = framed(swarmAt(0), { shields: [[1, 0, []]] }, 100);
    const stopped = framed(alive, { shields: [[1, 1, []]] }, 200);
    expect(newsOf(alive, stopped, A)).toBe("Ada was stopped by the others");
    expect(newsOf(stopped, framed(stopped, {}, 300), A)).toBeUndefined();
  });
});

test("a shield with less than three seconds left is a warning", () => {
  const state = (left: number) =>
    shieldWords(framed(swarmAt(0), { shields: [[1, 0, [[2, 90], [3, left]]]] }, 100), A).split("\n")[0];
  expect([state(31), state(30), state(29), state(0)]).toEqual(["whole", "whole", "low", "thin"]);
});
