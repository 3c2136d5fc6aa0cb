// @vitest-environment jsdom
// The editor against a gateway that answers as it likes.

import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { type Json, NO_SWARM, NO_VISIT, Refused, Unanswered, UsageError } from "../../client";
import type { RunningMission } from "../gateway_state";
import type { Station } from "../station";
import { Editor } from "./editor";

const WORLD = {
  name: "two rooms",
  bounds: [0, 0, 8, 6],
  start: [1.5, 3],
  walls: [[0, 0, 8, 0]],
  sites: [{ type: "doorway", at: [5, 3], see: { doorway: [5, 3], facing: 90 }, width: 1.2 }],
};
const ROW = { name: "door1", candidates: 278, core_s: 2.78, gpu_s: 0.00993, robot_ms: 170, by_plan: null, problems: ["too near"], infeasible: [], out_of_reach: false };
const COMPILED = {
  state: "compiled",
  id: "ab".repeat(16),
  name: "mission",
  nodes: 2,
  bytes: 634,
  profile: "sealed",
  audit: { nodes: [ROW], core_s: null, gpu_s: null, nearest_core_s: null, nearest_gpu_s: null, plan_core_s: 61, plan_gpu_s: 0.5, robot_ms: 170, out_of_reach: 1, problems: ["nothing can be tried"] },
  rates: { hash_core: 1.4e7, hash_gpu: 5e9, kdf_core: 100, kdf_gpu: 28_000 },
  unseen: ["door1"],
};

type Answer = () => unknown;
let answers: Record<string, Answer> = {};
let asked: { readonly what: string; readonly words: object }[] = [];
const station: Station = {
  source: { view: { swarm: NO_SWARM, health: { state: "live" }, visit: NO_VISIT }, subscribe: () => () => {} },
  hold: () => Promise.resolve(undefined),
  ask: (name, words = {}) => {
    const what = name.replace("mission_", "");
    asked.push({ what, words });
    return Promise.resolve().then(answers[what] ?? (() => Promise.reject(new Refused("unknown")))) as Promise<Json>;
  },
};
let root: Root | undefined;

beforeEach(async () => {
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.useFakeTimers();
  asked = [];
  answers = {
    world: () => WORLD,
    running: () => ({}),
    compile: () => ({}),
    job: () => COMPILED,
    send: () => ({}),
  };
});

afterEach(() => {
  act(() => root?.unmount());
  document.body.replaceChildren();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

async function open(running?: RunningMission): Promise<void> {
  root = createRoot(document.body.appendChild(document.createElement("div")));
  await act(async () => root?.render(<Editor station={station} running={running} />));
  await pass(0);
}

async function pass(ms: number): Promise<void> {
  await act(async () => {
    await vi.advanceTimersByTimeAsync(ms);
  });
}

const part = (id: string) => document.querySelector<HTMLElement>(`[data-testid="${id}"]`);
async function press(id: string): Promise<void> {
  await act(async () => part(id)?.click());
  await pass(0);
}

describe("the mission editor", () => {
  it("sends what was drawn, tells how far the compiler is, and what a file is worth", async () => {
    await open();
    await press("add-site");
    expect((part("send") as HTMLButtonElement).disabled).toBe(true);
    answers["job"] = () => ({ state: "compiling", done: 3, of: 9 });
    await press("compile");
    const compile = asked.find(({ what }) => what === "compile");
    const body = compile?.words as { mission: string; profile: string };
    expect(body.profile).toBe("sealed");
    expect(body.mission).toContain('"door1": {see: {doorway: [5, 3], facing: 90}, width: 1.2}');
    await pass(300);
    expect(part("mission-status")?.textContent).toBe("Compiling: 3 of 9 locks");
    answers["job"] = () => COMPILED;
    await pass(300);
    expect(part("audit")?.textContent).toContain("door1too near2782.78 s9.93 ms–170 ms");
    expect(part("audit")?.textContent).toContain("All readable nodes, at mostnothingnothing");
    expect(part("audit")?.textContent).toContain("same, with the map1.02 min500 ms");
    expect(part("audit")?.textContent).toContain("door1: the building shows no such landmark");
    await press("send");
    expect(asked.at(-1)?.words).toEqual({ id: COMPILED.id });
    expect(part("mission-status")?.textContent).toBe("Sent.");
    expect((part("send") as HTMLButtonElement).disabled).toBe(true);
  });

  it("shows the mission that runs, and how far robots are with it", async () => {
    const node = { name: "door", words: { final: true, see: { doorway: [5, 3] } }, at: [5, 3], type: "doorway" };
    answers["running"] = () => ({ name: "through", nodes: [node], ways: [], rest: {} });
    await open({ id: "ab", name: "through", nodes: 2, left: 1, completed: 0 });
    expect((part("mission-name") as HTMLInputElement).value).toBe("through");
    expect(part("nodes")?.querySelectorAll("li")).toHaveLength(1);
    expect(part("mission-status")?.textContent).toContain("carry out the mission: 1 of 2 nodes decoded");
    await act(async () => part("nodes")?.querySelector<HTMLButtonElement>("li button")?.click());
    expect(part("mission-status")?.textContent).toContain("Compiling turns every landmark");
  });

  it("does not send what was changed since it was compiled", async () => {
    await open();
    await press("compile");
    await pass(300);
    expect((part("send") as HTMLButtonElement).disabled).toBe(false);
    await press("add-site");
    expect((part("send") as HTMLButtonElement).disabled).toBe(true);
    expect(part("audit")).toBeNull();
    await press("undo");
    expect((part("send") as HTMLButtonElement).disabled).toBe(false);
  });

  it("says what is wrong with a mission that compiles", async () => {
    await open();
    await press("compile");
    await pass(300);
    expect(part("mission-status")?.textContent).toBe("Compiled, but look at this: door1: too near (and 1 more below)");
    const fine = { ...COMPILED, unseen: [], audit: { ...COMPILED.audit, nodes: [{ ...ROW, problems: [] }] } };
    answers["job"] = () => fine;
    await press("compile");
    await pass(300);
    expect(part("mission-status")?.textContent).toContain("Compiled. Send places");
    answers["job"] = () => ({ ...fine, audit: { ...fine.audit, nodes: [{ ...ROW, problems: [], infeasible: ["too far"] }] } });
    await press("compile");
    await pass(300);
    expect(part("mission-status")?.textContent).toBe("Compiled, but look at this: door1: infeasible too far");
  });

  it("says in one line what went wrong, and what to do", async () => {
    await open();
    const trouble = () => part("mission-trouble")?.textContent;
    for (const [what, answer, said] of [
      ["compile", () => ({ error: "no such profile", hint: "sealed or paper" }), "no such profileHint: sealed or paper"],
      ["compile", () => Promise.reject(new UsageError("too long")), "The mission is too long for this page.Hint: use phalanx mission build"],
      ["compile", () => Promise.reject(new Unanswered("no answer")), "The gateway does not answer."],
      ["job", () => ({ state: "failed", error: "no start", hint: "mark one" }), "no startHint: mark one"],
      ["job", () => ({ state: "compiled" }), "Gateway and page are of different versions.Hint: reload this page"],
    ] as const) {
      const before = answers[what];
      answers[what] = answer;
      await press("compile");
      await pass(300);
      expect(trouble()).toBe(said);
      expect((part("compile") as HTMLButtonElement).disabled).toBe(false);
      if (before) answers[what] = before;
    }
  });

  it("takes what a robot does at a node that is picked", async () => {
    await open();
    await act(async () => part("nodes")?.querySelector("input")?.focus());
    for (const [word, typed] of [["do", "pick shelf=3"], ["wait", "go, on"], ["within_m", "1.5"], ["timeout_s", "soon"]]) {
      const input = part(`word-${word}`) as HTMLInputElement;
      input.value = typed ?? "";
      await act(async () => {
        input.focus();
        input.blur();
      });
    }
    await press("compile");
    expect((asked.find(({ what }) => what === "compile")?.words as { mission: string }).mission).toContain(
      'do: {"pick": {"shelf": 3}}, wait: ["go", "on"], within_m: 1.5, timeout_s: "soon"}',
    );
  });

  it("says so when the building cannot be had", async () => {
    answers["world"] = () => ({ ...WORLD, walls: "none" });
    await open();
    expect(part("mission-trouble")?.textContent).toContain("different versions");
  });
});
