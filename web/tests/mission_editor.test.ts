// The mission editor's model: drafts, undo, and the YAML that the compiler reads.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { readDraft, readJob, readWorld } from "../operator/mission/desk";
import {
  type Draft,
  type Edit,
  type History,
  historyReducer,
  nearest,
  newDraft,
  type Site,
  toYaml,
  wayBetween,
} from "../operator/mission/draft";
import { readWord, shownWord } from "../operator/mission/node_words";
import { brief, span } from "../operator/mission/worth";

const DOOR: Site = { type: "doorway", at: [9, 12], see: { doorway: [9, 12], facing: 90 }, width: 2 };
const ROOM: Site = { type: "room", at: [5, 5], see: [{ room: [5, 5], area: 20 }, { room: [5.1, 5], area: 19 }], width: undefined };
const EMPTY: History = { now: newDraft([0, 0, 40, 40], [3, 1.5]), past: [] };
const play = (edits: readonly Edit[], from: History = EMPTY) => edits.reduce(historyReducer, from);
const names = (history: History) => history.now.nodes.map(({ name }) => name);

describe("drawing", () => {
  test("a mission begins where robots do, and grows by landmarks and ways", () => {
    const { now } = play([
      { kind: "site", site: DOOR },
      { kind: "site", site: ROOM },
      { kind: "place", at: [20, 20] },
      { kind: "connect", from: "start", to: "door1" },
      { kind: "connect", from: "door1", to: "room1" },
      { kind: "final", name: "room1" },
    ]);
    expect(now.nodes.map(({ name, start, final }) => [name, start, final])).toEqual([
      ["start", true, false],
      ["door1", false, false],
      ["room1", false, true],
      ["place1", false, false],
    ]);
    expect(wayBetween(now, "door1", "start")).toMatchObject({ from: "start", to: "door1", both: true });
    expect(toYaml(now)).toBe(
      [
        'mission: "mission"',
        "area: [0, 0, 40, 40]",
        "nodes:",
        '  "start": {start: true, see: {position: [3, 1.5]}}',
        '  "door1": {see: {doorway: [9, 12], facing: 90}, width: 2}',
        '  "room1": {see: [{room: [5, 5], area: 20}, {room: [5.1, 5], area: 19}], final: true}',
        '  "place1": {see: {position: [20, 20]}}',
        "ways:",
        '  - {from: "start", to: "door1", both: true}',
        '  - {from: "door1", to: "room1", both: true}',
        "",
      ].join("\n"),
    );
  });

  test("a landmark is taken once, a way is drawn once, and neither to what is not there", () => {
    const drawn = play([
      { kind: "site", site: DOOR },
      { kind: "connect", from: "start", to: "door1" },
    ]);
    for (const edit of [
      { kind: "site", site: DOOR },
      { kind: "connect", from: "door1", to: "start" },
      { kind: "connect", from: "door1", to: "door1" },
      { kind: "connect", from: "door1", to: "nowhere" },
      { kind: "rename", name: "door1", to: "start" },
      { kind: "rename", name: "door1", to: "  " },
    ] as const)
      expect(historyReducer(drawn, edit)).toBe(drawn);
  });

  test("a name follows into its ways, and what is removed takes its ways along", () => {
    const drawn = play([
      { kind: "site", site: DOOR },
      { kind: "site", site: ROOM },
      { kind: "connect", from: "start", to: "door1" },
      { kind: "connect", from: "door1", to: "room1" },
      { kind: "rename", name: "door1", to: "lobby door" },
    ]);
    expect(drawn.now.ways.map(({ from, to }) => [from, to])).toEqual([
      ["start", "lobby door"],
      ["lobby door", "room1"],
    ]);
    const removed = play([{ kind: "remove", name: "lobby door" }], drawn);
    expect(names(removed)).toEqual(["start", "room1"]);
    expect(removed.now.ways).toEqual([]);
  });

  test("a way turns: both ways, there, back; one that an action belongs to keeps its ends", () => {
    let history = play([
      { kind: "site", site: DOOR },
      { kind: "connect", from: "start", to: "door1" },
    ]);
    const seen = new Set<string>();
    for (let i = 0; i < 3; i += 1) {
      const [way] = history.now.ways;
      if (!way) throw new Error("the way is gone");
      seen.add(`${way.from} ${way.both} ${way.to}`);
      history = historyReducer(history, { kind: "turn", way });
    }
    expect(seen).toEqual(new Set(["start true door1", "start false door1", "door1 false start"]));
    expect(history.now.ways[0]?.both).toBe(true);
    const lift = { from: "a", to: "b", both: false, rest: { do: "lift" } };
    const lifted = historyReducer({ now: { ...history.now, ways: [lift] }, past: [] }, { kind: "turn", way: lift });
    expect(lifted.now.ways).toEqual([{ ...lift, both: true }]);
  });

  test("a word of a node is set, taken out and undone", () => {
    const set = play([{ kind: "word", name: "start", word: "within_m", value: 2 }]);
    expect(set.now.nodes[0]?.words).toMatchObject({ within_m: 2 });
    const out = play([{ kind: "word", name: "start", word: "within_m", value: undefined }], set);
    expect(out.now.nodes[0]?.words).toEqual(EMPTY.now.nodes[0]?.words);
    expect(play([{ kind: "undo" }], out).now).toEqual(set.now);
  });

  test("words are typed as they are shown", () => {
    for (const [word, value, typed] of [
      ["within_m", 1.5, "1.5"],
      ["timeout_s", "soon", "soon"],
      ["do", "lift", "lift"],
      ["do", { pick: { shelf: 3, from: "the left" } }, "pick shelf=3 from=the left"],
      ["wait", ["door open", "go"], "door open, go"],
      ["send", undefined, ""],
    ] as const) {
      expect(shownWord(value)).toBe(typed);
      expect(readWord(word, typed)).toEqual(value);
    }
    expect(shownWord({ lift: {} })).toBe("lift");
    expect(readWord("wait", " go ,, on ")).toEqual(["go", "on"]);
  });

  test("everything can be taken back, a typed title at once", () => {
    const title = ["a", "ab", "abc"].map((name) => ({ kind: "title", name }) as const);
    const drawn = play([{ kind: "site", site: DOOR }, ...title, { kind: "remove", name: "door1" }]);
    expect(names(drawn)).toEqual(["start"]);
    const once = play([{ kind: "undo" }], drawn);
    expect([names(once), once.now.name]).toEqual([["start", "door1"], "abc"]);
    const twice = play([{ kind: "undo" }], once);
    expect([names(twice), twice.now.name]).toEqual([["start", "door1"], "mission"]);
    expect(play([{ kind: "undo" }, { kind: "undo" }, { kind: "undo" }], twice).now).toBe(EMPTY.now);
  });

  test("whatever is done, names are unique, ways lead somewhere, and undo leads back to the beginning", () => {
    const name = fc.constantFrom("start", "door1", "room1", "place1", "place2", "x");
    const at = fc.tuple(fc.integer({ min: 0, max: 40 }), fc.integer({ min: 0, max: 40 }));
    const edit: fc.Arbitrary<Edit> = fc.oneof(
      fc.record({ kind: fc.constant("site" as const), site: fc.constantFrom(DOOR, ROOM) }),
      fc.record({ kind: fc.constant("place" as const), at }),
      fc.record({ kind: fc.constantFrom("remove" as const, "start" as const, "final" as const), name }),
      fc.record({ kind: fc.constant("rename" as const), name, to: name }),
      fc.record({ kind: fc.constant("connect" as const), from: name, to: name }),
      fc.constant({ kind: "undo" } as const),
    );
    fc.assert(
      fc.property(fc.array(edit, { maxLength: 40 }), (edits) => {
        const history = play(edits);
        const known = names(history);
        expect(new Set(known).size).toBe(known.length);
        for (const { from, to } of history.now.ways) expect(known).toEqual(expect.arrayContaining([from, to]));
        expect(play(Array.from({ length: 50 }, () => ({ kind: "undo" }) as const), history).now).toBe(EMPTY.now);
      }),
    );
  });

  test("a tap takes the nearest within reach, and nothing beyond", () => {
    expect(nearest([DOOR, ROOM], [8.6, 12], 0.5)).toBe(DOOR);
    expect(nearest([DOOR, ROOM], [8.4, 12], 0.5)).toBeUndefined();
    expect(nearest([{ at: undefined }, DOOR], [9, 12], 0.5)).toBe(DOOR);
  });

  test("strange names and numbers are written so that YAML reads them as they are", () => {
    const odd: Draft = {
      name: 'yes: "no" # {',
      nodes: [
        { name: "on", start: true, final: false, words: { do: { lamp: { off: 1e-7, far: 1e21 } } }, at: undefined, type: "" },
      ],
      ways: [],
      rest: {},
    };
    expect(toYaml(odd)).toBe(
      'mission: "yes: \\"no\\" # {"\nnodes:\n  "on": {start: true, do: {"lamp": {"off": 1.0e-7, "far": 1.0e+21}}}\n',
    );
    expect(toYaml({ ...odd, nodes: [] })).toContain("nodes: {}\n");
  });
});

describe("answers of the gateway", () => {
  test("a mission that was read keeps the words for which there is no button", () => {
    const draft = readDraft({
      name: "delivery",
      rest: { coding: { delta_mm: 400 } },
      nodes: [
        { name: "shelf", words: { final: true, see: { qr: [1, 2], token: "00" }, do: { pick: { shelf: 3 } } }, at: [1, 2], type: "qr" },
        { name: "rest", words: { see: { sensor: "red" } }, at: null, type: "" },
      ],
      ways: [{ from: "shelf", to: "rest", both: false, rest: { direction: 140 } }],
    });
    expect(draft.nodes[0]).toMatchObject({ final: true, start: false, words: { do: { pick: { shelf: 3 } } } });
    expect(toYaml(draft)).toContain('{see: {qr: [1, 2], token: "00"}, do: {"pick": {"shelf": 3}}, final: true}');
    expect(toYaml(draft)).toContain('- {from: "shelf", to: "rest", direction: 140}');
    expect(toYaml(draft)).toContain('coding: {"delta_mm": 400}');
  });

  test("what is no answer throws, and is never half believed", () => {
    const throwing = (read: (json: unknown) => unknown) =>
      fc.assert(
        fc.property(fc.jsonValue(), (json) => {
          if (!(typeof json === "object" && json !== null && "state" in json)) expect(() => read(json)).toThrow(TypeError);
        }),
      );
    for (const read of [readWorld, readDraft, readJob]) throwing(read);
    expect(() => readJob({ state: "compiled", id: "x" })).toThrow(TypeError);
  });

  test("times and counts are said as the command line says them", () => {
    expect([0.0000285, 0.0296, 8.28, 2766, 5.2e6, 6.3e8].map(span)).toEqual(["28.5 µs", "29.6 ms", "8.28 s", "46.1 min", "60.2 days", "20 years"]);
    expect([828, 4610.4, 1.4e7, 28_000].map(brief)).toEqual(["828", "4610", "1.40e7", "28000"]);
  });
});
