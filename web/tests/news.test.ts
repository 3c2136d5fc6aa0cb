// What visitors are told beside the map: who else drives, who arrived, who was stopped.

import { describe, expect, test } from "vitest";
import { driversOf, type Json, NO_SWARM, type Swarm, swarmReducer } from "../client";
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
  test("all but ourselves are counted, also those who give no name, for as long as they are told", () => {
    let swarm = framed(swarmAt(0), { drivers: [[1, ["me", "you", ""]], [2, ["me"]]] }, 1000);
    expect([driversOf(swarm, A, "me"), driversOf(swarm, B, "me"), driversOf(swarm, undefined, "me")]).toEqual([2, 0, 0]);
    swarm = framed(swarm, {}, 1900);
    expect(driversOf(swarm, A, "me")).toBe(2);
    swarm = framed(swarm, {}, 2300);
    expect(driversOf(swarm, A, "me")).toBe(0);
  });

  test("whatever a peer says, nothing is thrown, and nothing grows without end", () => {
    const words = [null, [], [1], [1, 2], [99, ["x"]], [1, [3, null, "y".repeat(1000)]], [2, Array(1000).fill("z")]];
    const swarm = framed(swarmAt(0), { drivers: words }, 1000);
    expect(swarm.drivers.get(A)?.names.every((name) => name.length <= 8)).toBe(true);
    expect(swarm.drivers.get(B)?.names).toHaveLength(8);
  });
});

describe("news", () => {
  test("a robot whose route ends at its end has arrived; elsewhere it was only stopped", () => {
    const [far, near] = [swarmAt(100, { waypoints: POINTS }), swarmAt(470, { waypoints: POINTS })];
    expect(newsOf(near, framed(near, { changed: [{ address: A, waypoints: [] }] }, 100), A)).toBe("Ada has arrived");
    expect(newsOf(far, framed(far, { changed: [{ address: A, waypoints: [] }] }, 100), A)).toBeUndefined();
    expect(newsOf(near, framed(near, {}, 100), A)).toBeUndefined();
  });

  test("a robot that goes into Safe Mode was stopped; one that was already is no news", () => {
    const alive = framed(swarmAt(0), { shields: [[1, 0, []]] }, 100);
    const stopped = framed(alive, { shields: [[1, 1, []]] }, 200);
    expect(newsOf(alive, stopped, A)).toBe("Ada was stopped: Safe Mode");
    expect(newsOf(stopped, framed(stopped, {}, 300), A)).toBeUndefined();
  });
});

test("a shield with less than three seconds left is a warning", () => {
  const state = (left: number) =>
    shieldWords(framed(swarmAt(0), { shields: [[1, 0, [[2, 90], [3, left]]]] }, 100), A).split("\n")[0];
  expect([state(31), state(30), state(29), state(0)]).toEqual(["whole", "whole", "low", "thin"]);
});
