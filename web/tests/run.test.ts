// A run at a moment, without a page.

import { describe, expect, test } from "vitest";
import { type Line, Run } from "../viewer/run";

const LINES: readonly Line[] = [
  { about: { name: "small", defence: "bound", tokens_needed: "2", t_val_ms: "10000" } },
  {
    t: 0,
    at: [[1, 0, 0, 0], [2, 9000, 9000, 90]],
    lies: [[2, "spoof"]],
    marks: [[4000, 4000]],
    walls: [[0, 9000, 9000, 9000]],
    shields: [[1, false, [[2, 5.5]]], [2, true, []]],
    audits: [[0.4, 1, 2, "output wrong"], [0.5, 2, 1, ""]],
  },
  { t: 1, at: [[1, 1000, 0, 0], [2, 9000, 9000, 90]], lies: [[2, "spoof"]], events: [[1, 2, "in Safe Mode"]] },
  { t: 9, at: [[1, 9000, 0, 0], [2, 9000, 9000, 90]], lies: [[2, "spoof"]] },
];

function made(): Run {
  const run = new Run();
  run.add(LINES);
  return run;
}

describe("a run", () => {
  test("robots glide between steps that are near, y points up, noses where they go", () => {
    const run = made();
    const at = (t: number, robot: string) => run.swarmAt(t, 1, 0).robots.get(robot)?.position;
    const [one, two] = [at(0, "1"), at(0, "2")];
    expect((two?.x ?? 0) - (one?.x ?? 0)).toBeCloseTo(9000);
    expect((one?.y ?? 0) - (two?.y ?? 0)).toBeCloseTo(9000);
    expect((at(0.5, "1")?.x ?? 0) - (one?.x ?? 0)).toBeCloseTo(500);
    expect((at(5, "1")?.x ?? 0) - (one?.x ?? 0)).toBeCloseTo(1000);
    const { area, missions, robots } = run.swarmAt(0, 1, 0);
    for (const { x, y } of [one, two, ...(missions?.lit ?? [])].flatMap((place) => place ?? [])) {
      expect(x > 0 && y > 0 && x < area.width && y < area.height).toBe(true);
    }
    expect(missions?.walls?.[0]?.[1]).toBeCloseTo(two?.y ?? NaN);
    // To the right: 270 degrees; upwards: 180 (docs/spec/vocabulary.md).
    expect([robots.get("1")?.direction, robots.get("2")?.direction]).toEqual([270, 180]);
  });

  test("tokens run out by the run's clock, whoever looks and however fast", () => {
    const run = made();
    for (const [t, now_ms] of [[0, 0], [0.5, 777]] as const) {
      const { shield } = run.swarmAt(t, 4, now_ms).robots.get("1") ?? {};
      expect((shield?.vouchers[0]?.until_ms ?? 0) - now_ms).toBeCloseTo(5500 - t * 1000);
    }
    expect(run.swarmAt(0, 1, 0).robots.get("2")).toMatchObject({ name: "2 lies", shield: { safeMode: true } });
    expect(run.swarmAt(0, 1, 0).terms).toEqual({ needed: 2, full_ms: 10_000 });
  });

  test("who lies or was stopped is drawn over the others", () => {
    const run = new Run();
    const at = [4, 3, 2, 1].map((robot) => [robot, 0, 0, 0] as const);
    run.add([{ t: 0, at, lies: [[3, "spoof"]], shields: [[4, true, []], [2, false, []]] }]);
    expect([...run.swarmAt(0, 1, 0).robots.keys()]).toEqual(["2", "1", "4", "3"]);
  });

  test("an audit is seen from its moment on, for so long of the watcher's time, a refusal above the others", () => {
    const run = made();
    const refusals = (t: number, speed: number) => run.swarmAt(t, speed, 1000).audits.map(({ refusal }) => refusal);
    expect(refusals(0.39, 1)).toEqual([]);
    expect(refusals(0.6, 1)).toEqual(["", "output wrong"]);
    expect(refusals(2.3, 1)).toEqual([]);
    expect(refusals(2.3, 2)).toEqual(["", "output wrong"]);
    expect(run.swarmAt(2.4, 2, 1000).audits.at(-1)?.at_ms).toBeCloseTo(0);
    expect(run.events.map(([t, robot]) => [t, robot])).toEqual([[0.4, 2], [1, 2]]);
  });

  test("before anything came there is nothing, and lines may come in any pieces", () => {
    expect(new Run().swarmAt(3, 1, 0).robots.size).toBe(0);
    const pieces = new Run();
    for (const line of LINES) pieces.add([line]);
    expect(pieces.swarmAt(0.5, 1, 0).robots).toEqual(made().swarmAt(0.5, 1, 0).robots);
    expect(pieces.end_s).toBe(9);
  });

  test("a step may hold more than a stack does, and so much is drawn", () => {
    const run = new Run();
    const many = <T>(one: T): T[] => Array<T>(130_000).fill(one);
    run.add([{ t: 0, at: [], lies: [], marks: many([1, 1]), walls: many([0, 0, 1, 1]), events: many([0, 1, "x"]) }]);
    expect(run.events.length).toBe(130_000);
    const { missions } = run.swarmAt(0, 1, 0);
    expect([missions?.lit?.length, missions?.walls?.length]).toEqual([10_000, 10_000]);
  });
});
