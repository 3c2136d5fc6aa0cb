// The stop: on a tablet it is asked for until it is answered, on the gateway's machine it passes by the link.

import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { type Json, Refused, type SessionConnection, type SwarmLink, Unanswered } from "../client";
import { Local } from "./local";
import { LinkStation } from "./station";

let asked: string[] = [];
let answers: (() => Promise<Json>)[] = [];
const away = () => Promise.reject(new Unanswered("not connected"));
const link = {
  transport: {
    visit: { stage: "here" },
    ask: (what: string) => {
      asked.push(what);
      return (answers.shift() ?? away)();
    },
  },
} as unknown as SwarmLink<SessionConnection>;

beforeEach(() => {
  vi.useFakeTimers();
  asked = [];
  answers = [];
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

async function held(station: LinkStation, is: boolean): Promise<string | undefined> {
  const said = station.hold(is);
  await vi.advanceTimersByTimeAsync(30_000);
  return await said;
}

describe("the operator's stop", () => {
  it("is asked for again until it is answered", async () => {
    answers = [away, () => Promise.reject(new Refused("too_many")), () => Promise.resolve({})];
    expect(await held(new LinkStation(link, undefined), true)).toBeUndefined();
    expect(asked).toEqual(["stop", "stop", "stop"]);
  });

  it("is given up in the end, and said to be", async () => {
    expect(await held(new LinkStation(link, undefined), true)).toContain("does not answer");
    expect(asked.length).toBeGreaterThan(10);
  });

  it("is not asked for again once it is refused, nor after it was taken back", async () => {
    answers = [() => Promise.reject(new Refused("not_allowed"))];
    expect(await held(new LinkStation(link, undefined), true)).toContain("not allowed");
    expect(asked).toEqual(["stop"]);
    const station = new LinkStation(link, undefined);
    const first = station.hold(true);
    await held(station, false);
    await first;
    expect(asked).toEqual(["stop", "stop", "go"]);
  });

  it("goes by the listener of this machine, with the token in a header", async () => {
    const fetched: (readonly [string, RequestInit])[] = [];
    vi.stubGlobal("fetch", (url: string, init: RequestInit) => {
      fetched.push([url, init]);
      return Promise.resolve(Response.json({}));
    });
    expect(await held(new LinkStation(link, new Local("t0ken")), true)).toBeUndefined();
    expect(asked).toEqual([]);
    expect(fetched[0]?.[0]).toBe("/api/stop");
    expect(fetched[0]?.[1]).toMatchObject({ method: "POST", headers: { Authorization: "Bearer t0ken" } });
  });
});
