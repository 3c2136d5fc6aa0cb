// Shields: what pages make of a gateway's words about them, and how they are put for people.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { counting, type Json, NO_SWARM, type Point, type Robot, type Swarm, swarmReducer } from "../client";
import { fitArea } from "../map/projection";
import { drawRobots } from "../map/scene";
import type { Theme } from "../map/theme";
import { shieldWords } from "../visitor/shield_words";

const A = "DECAFBAD00000001";
const B = "DECAFBAD00000002";
const C = "DECAFBAD00000003";

type Action = Parameters<typeof swarmReducer>[1];
const play = (actions: readonly Action[], from: Swarm = NO_SWARM) => actions.reduce(swarmReducer, from);
const told = (request: number, data: unknown, at_ms = 0) =>
  ({ kind: "replied", request, data: data as Json, at_ms }) as const;
const frame = (seq: number, at_ms: number, more: object) =>
  ({ kind: "notified", payload: { cmd: 16, data: { seq, ...more } } as Json, at_ms }) as const;

const robot = (address: string, n: number, name: string, shield: unknown = [0, []]) => ({ address, n, name, shield });
const AREA = { width: 2000, height: 2000, tokens_needed: 2, t_val_ms: 10_000, most_waypoints: 32 };
const START = play([
  told(1, AREA),
  told(0, [robot(A, 1, "Ada", [0, [[2, 90], [3, 40]]]), robot(B, 2, "Bo"), robot(C, 3, "Cleo")], 1000),
]);
const words = (swarm: Swarm, address = A) => shieldWords(swarm, address).split("\n");

describe("shields", () => {
  test("the list tells who vouches for whom, and until when", () => {
    expect(START.terms).toEqual({ needed: 2, full_ms: 10_000 });
    expect(START.robots.get(A)?.shield).toEqual({
      safeMode: false,
      vouchers: [
        { auditor: 2, until_ms: 10_000 },
        { auditor: 3, until_ms: 5000 },
      ],
    });
    expect(words(START)).toEqual([
      "whole",
      "Protected: 2 neighbours vouch for it",
      "Each vouches for a while: Bo 9 s, Cleo 4 s.",
      "Unless checked again, it stops in 4 s.",
      "It was not checked yet.",
    ]);
  });

  test("tokens drain without another word, and frames renew them", () => {
    const later = play([frame(1, 6000, {})], START);
    expect(words(later)[0]).toBe("thin");
    expect(words(later).slice(1, 3)).toEqual(["Too few neighbours vouch for it: 1 of 2", "Each vouches for a while: Bo 4 s."]);
    const renewed = play([frame(2, 7000, { shields: [[1, 0, [[3, 100], [2, 30]]]] })], later);
    expect(words(renewed)[2]).toBe("Each vouches for a while: Cleo 10 s, Bo 3 s.");
    const low = play([frame(3, 8000, {})], renewed);
    expect(words(low).slice(0, 2)).toEqual(["low", "Protected for 2 s more"]);
  });

  test("only so many tokens count as are needed, those that count longest", () => {
    const shield = { safeMode: false, vouchers: [9, 8, 7, 0].map((s, auditor) => ({ auditor, until_ms: s * 1000 })) };
    expect(counting(shield, { needed: 2, full_ms: 10_000 }, 0).map(({ auditor }) => auditor)).toEqual([0, 1]);
  });

  test("a refused audit is remembered with its reason, beyond the next list of robots", () => {
    const refused = play([frame(1, 2000, { audits: [[2, 1, "output wrong"], [3, 2, ""]] })], START);
    expect(refused.audits).toEqual([
      { auditor: B, auditee: A, refusal: "output wrong", at_ms: 2000 },
      { auditor: C, auditee: B, refusal: "", at_ms: 2000 },
    ]);
    expect(words(refused).at(-1)).toBe("Last check, by Bo: failed. It did not follow its program.");
    expect(words(refused, B).at(-1)).toBe("Last check, by Cleo: passed.");
    const again = play([told(0, [robot(A, 1, "Ada"), robot(B, 2, "Bo")], 3000)], refused);
    expect(words(again).at(-1)).toContain("did not follow");
    expect(play([frame(2, 9000, {})], refused).audits).toEqual([]);
  });

  test("who comes late is told the last verdict with the list, and sees no line for it", () => {
    const ada = { ...robot(A, 1, "Ada", [1, []]), audited: [2, "output wrong"] };
    const late = play([told(1, AREA), told(0, [ada, { ...robot(B, 2, "Bo"), audited: null }], 1000)]);
    expect(words(late).at(-1)).toBe("Last check, by Bo: failed. It did not follow its program.");
    expect(words(late, B).at(-1)).toBe("It was not checked yet.");
    expect(late.audits).toEqual([]);
  });

  test("a robot in Safe Mode is said to be stopped, and to obey nobody", () => {
    const stopped = play([frame(1, 2000, { shields: [[1, 1, []]] })], START);
    expect(words(stopped)[0]).toBe("stopped");
    expect(words(stopped)[1]).toBe("Stopped: too few neighbours vouch for it");
    expect(words(stopped)[2]).toContain("stays stopped");
  });

  test("no seconds are told while nothing is heard", () => {
    const lost = shieldWords(START, A, false);
    expect(lost.split("\n").slice(0, 2)).toEqual(["unknown", "Protection unknown: no news now"]);
    expect(lost).not.toMatch(/\d s/);
  });

  test("of a swarm without shields nothing is said", () => {
    const plain = play([told(1, { width: 2000, height: 2000 }), told(0, [{ address: A }])]);
    expect(shieldWords(plain, A)).toBe("none");
    expect(plain.robots.get(A)?.shield).toBeUndefined();
  });

  test("why robots are unprotected is said whoever is chosen, and gone when they are not", () => {
    const plain = play([told(1, { ...AREA, t_val_ms: undefined, unprotected: "too\nmany" }), told(0, [{ address: A }])]);
    expect([shieldWords(plain, A), shieldWords(plain, undefined)]).toEqual(Array(2).fill("unprotected\nToomany."));
    expect(shieldWords(play([told(1, AREA)], plain), undefined)).toContain("check each other");
  });

  test("nonsense never throws, and what is kept stays small", () => {
    const rows = fc.array(fc.jsonValue(), { maxLength: 300 });
    fc.assert(
      fc.property(rows, rows, fc.jsonValue(), fc.jsonValue(), (shields, audits, shield, audited) => {
        const many = audits.concat(Array.from({ length: 300 }, () => [1, 2, "\u202e\u0000".repeat(9)]));
        const swarm = play(
          [told(0, [{ ...robot(A, 1, "Ada"), shield, audited }, robot(B, 2, "Bo")]), frame(1, 1, { shields, audits: many })],
          START,
        );
        expect(swarm.audits.length).toBeLessThanOrEqual(256);
        for (const known of swarm.robots.values()) expect(known.shield?.vouchers.length ?? 0).toBeLessThanOrEqual(32);
        expect(words(swarm, B).at(-1)).toBe("Last check, by Ada: failed. Its records are inconsistent.");
      }),
    );
  });
});

describe("a stopped robot", () => {
  /** Where strokes from corner to corner cross. */
  function crosses(safeMode: boolean, selected?: string): Point[] {
    const middles: Point[] = [];
    let from: Point = { x: 0, y: 0 };
    const known: Record<string, unknown> = {
      moveTo: (x: number, y: number) => (from = { x, y }),
      lineTo: (x: number, y: number) => {
        const [dx, dy] = [x - from.x, y - from.y];
        if (dx > 0 && Math.abs(dx) === Math.abs(dy)) middles.push({ x: (x + from.x) / 2, y: (y + from.y) / 2 });
      },
    };
    const pen = new Proxy(known, { get: (target, name: string) => target[name] ?? (() => {}), set: () => true });
    const shield = { safeMode, vouchers: [] };
    const stopped = { address: A, status: 0, led: undefined, waypoints: [], position: { x: 0, y: 0 }, shield } as unknown as Robot;
    const swarm = { ...NO_SWARM, robots: new Map([[A, stopped]]) };
    const scene = { swarm, selected, draft: [], threshold: 0, cursor: undefined, marked: true, buttons: 1 };
    const p = fitArea(swarm.area, 300, 300);
    drawRobots(pen as unknown as CanvasRenderingContext2D, p, {} as Theme, scene, new Map([[A, { x: 70, y: 90 }]]), 0, true);
    return middles;
  }

  test("is crossed out, for eyes that see no colours and projectors that show none", () => {
    expect(crosses(true)).toEqual([{ x: 70, y: 90 }, { x: 70, y: 90 }]);
    expect(crosses(true, A).slice(-2), "over the chosen one too").toEqual([{ x: 70, y: 90 }, { x: 70, y: 90 }]);
    expect(crosses(false)).toEqual([]);
  });
});
