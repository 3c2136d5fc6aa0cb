// What a visitor reads of its own session.

import { describe, expect, test } from "vitest";
import { NO_SWARM, NO_VISIT, type Standing, swarmReducer, type Visit } from "../client";
import { othersWords } from "../visitor/robot_picker";
import { lastNickname, madeUp } from "../visitor/nickname";
import { linkUrl } from "../client";
import { mayDrive, overWords, refusedWords, standingWords, turnClock } from "../visitor/visit_words";

const A = "DECAFBAD00000001";
const DRIVES: Standing = { role: "drive", waiting: false, place: 0, left_ms: 0, robot: "" };

function here(standing: Partial<Standing>, more: Partial<Visit> = {}): Visit {
  return { ...NO_VISIT, stage: "here", name: "Ada", standing: { ...DRIVES, ...standing }, standingAt_ms: 1000, ...more };
}

const words = (standing: Partial<Standing>, now_ms = 1000) => standingWords(here(standing), NO_SWARM, now_ms);

describe("a visitor reads", () => {
  test("its role, its robot, its place in the queue and the rest of its turn", () => {
    expect(words({})).toBe("");
    expect(words({ role: "watch" })).toContain("You are watching");
    expect(words({ place: 2 })).toBe("You are number 2 in the queue for a robot.");
    expect(words({ robot: A })).toBe("A robot is yours.");
    expect(words({ robot: A, left_ms: 65_000 }, 1000)).toContain("for 1:05");
    expect(words({ robot: A, left_ms: 65_000 }, 58_500)).toContain("for 0:08");
    expect(words({ robot: A, left_ms: 65_000 }, 999_000)).toContain("for 0:00");
    expect(standingWords({ ...here({ place: 2 }), stage: "joining" }, NO_SWARM, 0)).toBe("");
    expect(turnClock(119_001)).toBe("2:00");
  });

  test("why a command was refused, for a while", () => {
    const visit = here({}, { refused: { reason: "busy", at_ms: 1000 } });
    expect(refusedWords(visit, 1500)).toBe("Another visitor drives this robot: only they and the operator can stop it");
    expect(refusedWords(visit, 5000)).toBe("");
    expect(refusedWords(here({}), 1500)).toBe("");
  });

  test("why its session is over, and a way back where there is one", () => {
    expect(overWords("removed")).toMatchObject({ title: "The operator removed you", again: undefined });
    expect(overWords("replaced").again).toBe("Use this tab");
    expect(overWords("code").title).toBe("This code is no longer valid");
  });

  test("who else drives, by name in a session", () => {
    const data = [{ address: A, drivers: ["Eve", "Ada"] }];
    const swarm = swarmReducer(NO_SWARM, { kind: "replied", request: 0, data, at_ms: 0 });
    const view = { swarm, health: { state: "live" } as const, visit: { ...here({}), name: "Ada" } };
    expect(othersWords(view, A)).toBe("Eve drives it");
    expect(othersWords({ ...view, visit: { ...view.visit, name: "Bob" } }, A)).toBe("2 other visitors drive it");
    expect(othersWords(view, undefined)).toBe("");
    const nameless = [{ address: A, drivers: ["Ada", ""] }];
    const driven = swarmReducer(NO_SWARM, { kind: "replied", request: 0, data: nameless, at_ms: 0 });
    expect(othersWords({ ...view, swarm: driven }, A)).toBe("Another visitor drives it");
  });

  test("may drive with a role for it, and not while it waits or queues", () => {
    const may = [{}, { role: "operate" }, { role: "watch" }, { waiting: true }, { place: 1 }] as const;
    expect(may.map((each) => mayDrive(here(each)))).toEqual([true, true, false, false, false]);
    expect(mayDrive(NO_VISIT)).toBe(false);
  });

  test("a nickname to begin with", () => {
    for (const chance of [0, 0.3, 0.9999999]) expect(madeUp(chance)).toMatch(/^[A-Z][a-z]+ [1-9][0-9]$/);
    expect(lastNickname({ getItem: () => "Ada" })).toBe("Ada");
    expect(lastNickname(undefined)).toBe("");
  });
});

test("the websocket is beside the page, also below a path and on https", () => {
  expect(linkUrl("http://h:8080/?lang=en#x")).toBe("ws://h:8080/link");
  expect(linkUrl("https://lab.example/swarm/")).toBe("wss://lab.example/swarm/link");
});
