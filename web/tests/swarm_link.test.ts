// A swarm's state kept over a connection: what is asked when, and that a slow list does not undo what frames said.

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { type Json, NO_VISIT, SwarmLink, type Transport } from "../client";
import { REQUEST_ROBOTS } from "../client/swarm";

const A = "DECAFBAD00000001";

interface Fake {
  emit: (event: unknown) => void;
  readonly asked: [at_ms: number, request: number][];
}

const fake: Fake = { emit: () => {}, asked: [] };

const transport: Transport = {
  state: "connecting",
  visit: NO_VISIT,
  listen(listener) {
    fake.emit = listener as Fake["emit"];
    return () => {};
  },
  command: () => true,
  async request(request: number): Promise<Json> {
    fake.asked.push([Math.round(performance.now()), request]);
    return new Promise(() => {});
  },
  wake() {},
  hide() {},
  leave() {},
  restart() {},
  close() {},
};

let link: SwarmLink;

beforeEach(() => {
  vi.useFakeTimers({ now: 0, toFake: ["performance", "setInterval", "clearInterval", "setTimeout", "clearTimeout"] });
  vi.spyOn(Math, "random").mockReturnValue(0);
  fake.asked.length = 0;
  link = new SwarmLink(transport);
  fake.emit({ kind: "broker", state: "online" });
});

afterEach(() => {
  link.close();
  vi.restoreAllMocks();
  vi.useRealTimers();
});

const robot = (green: number) => ({ address: A, n: 1, name: "Ada", rgb_led: { red: 0, green, blue: 0 } });
const list = (green: number) => fake.emit({ kind: "replied", request: 0, data: [robot(green)] });
const frame = (seq: number, more: object = {}) =>
  fake.emit({ kind: "notified", payload: { cmd: 16, data: { seq, ...more } } });
const lit = (green: number) => ({ changed: [{ address: A, rgb_led: { red: 0, green, blue: 0 } }] });
const green = () => link.view.swarm.robots.get(A)?.led?.green;
const askedAt = (request: number) => fake.asked.filter(([, what]) => what === request).map(([at_ms]) => at_ms);

/** Time passes, with a frame every 100 ms; the next one's number. */
function play(ms: number, seq: number): number {
  for (let past = 0; past < ms; past += 100) {
    vi.advanceTimersByTime(100);
    frame(seq);
    seq += 1;
  }
  return seq;
}

describe("a list that is slow to come", () => {
  test("is older than what frames said meanwhile", () => {
    frame(1);
    frame(2, lit(7));
    list(1);
    expect(green()).toBe(7);
  });

  test("is so, too, when it was asked for twice", () => {
    list(1);
    let seq = play(2000, 1);
    frame(seq + 1); // a gap: asked at once
    seq = play(3000, seq + 2);
    frame(seq + 1); // and again
    seq = play(3000, seq + 2);
    expect(askedAt(REQUEST_ROBOTS).length).toBeGreaterThanOrEqual(3);
    list(1);
    frame(seq, lit(9));
    list(1);
    expect(green()).toBe(9);
  });

  test("is newer than what was said before a gap", () => {
    list(1);
    frame(1, lit(5));
    frame(3); // what frame 2 said of the LED, the list knows
    list(6);
    expect(green()).toBe(6);
  });

  test("is newer than what was said half a minute ago", () => {
    list(1);
    frame(0, lit(5));
    play(31_000, 1);
    list(6);
    expect(green()).toBe(6);
  });

  test("is asked again if more was said than can be kept", () => {
    list(1);
    const seq = play(2000, 1);
    const asked = askedAt(REQUEST_ROBOTS).length;
    const much = { changed: [{ address: A, note: "x".repeat(900_000) }] };
    for (let i = 0; i < 3; i += 1) frame(seq + i, much);
    list(2);
    play(1000, seq + 3);
    expect(askedAt(REQUEST_ROBOTS).length).toBe(asked + 1);
  });
});

describe("asking", () => {
  test("beside frames for the list after a minute and then every ten", () => {
    let seq = 1;
    for (let minute = 0; minute < 25; minute += 1) {
      list(1);
      seq = play(60_000, seq);
    }
    const gaps = askedAt(REQUEST_ROBOTS).map((at_ms, i, all) => Math.round((at_ms - (all[i - 1] ?? 0)) / 60_000));
    expect(gaps).toEqual([0, 1, 10, 10]);
  });

  test("a broker that comes back is not asked by everybody at once", () => {
    vi.mocked(Math.random).mockReturnValue(0.5);
    list(1);
    play(2000, 1);
    fake.emit({ kind: "broker", state: "offline" });
    vi.advanceTimersByTime(100_000);
    const asked = fake.asked.length;
    fake.emit({ kind: "broker", state: "online" });
    vi.advanceTimersByTime(750);
    expect(fake.asked.length).toBe(asked);
    vi.advanceTimersByTime(750);
    expect(fake.asked.length).toBeGreaterThan(asked);
  });
});

describe("a device that says it has no network", () => {
  const offline = () => vi.stubGlobal("navigator", { onLine: false });
  afterEach(() => vi.unstubAllGlobals());

  test("is told so at once, also if a frame or two still came", () => {
    list(1);
    const seq = play(2000, 1);
    offline();
    play(300, seq);
    vi.advanceTimersByTime(700);
    expect(link.view.health).toEqual({ state: "offline", why: "network" });
  });

  test("is not, if it went on hearing the swarm without one", () => {
    list(1);
    const seq = play(2000, 1);
    offline();
    play(5000, seq);
    vi.advanceTimersByTime(1000);
    expect(link.view.health).toEqual({ state: "late" });
  });
});
