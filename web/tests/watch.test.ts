// When request 0 is asked again, and what the visitor is told.

import { describe, expect, test } from "vitest";
import { type Health, Watch } from "../client/watch";

/** Run a watch through `until_ms` in ticks of 100 ms; the times at which it asked. */
function askedAt(watch: Watch, from_ms: number, until_ms: number, each: (now_ms: number) => void = () => {}): number[] {
  const asked: number[] = [];
  for (let now_ms = from_ms; now_ms <= until_ms; now_ms += 100) {
    each(now_ms);
    if (watch.due(now_ms, 0)) asked.push(now_ms);
  }
  return asked;
}

function online(): Watch {
  const watch = new Watch(0);
  watch.broker("online", 0, 0.9);
  return watch;
}

function wellAt(watch: Watch, now_ms: number): void {
  watch.heard(now_ms);
  watch.answered();
}

const state = (health: Health) => health.state;

describe("asking", () => {
  test("at once when connected, and never while the broker is away", () => {
    expect(new Watch(0).due(60_000, 0)).toBe(false);
    const watch = online();
    expect(watch.due(0, 0)).toBe(true);
    watch.broker("offline", 10, 0.9);
    expect(askedAt(watch, 100, 20_000)).toEqual([]);
  });

  test("once a lost broker is back, within two seconds that chance spreads, and only once", () => {
    for (const answered of [true, false]) {
      const watch = online();
      watch.due(0, 0);
      if (answered) wellAt(watch, 100);
      watch.broker("offline", 2000, 0.9);
      watch.broker("online", 10_000, 0.5);
      expect(askedAt(watch, 10_000, 14_000, (now_ms) => now_ms > 11_000 && wellAt(watch, now_ms))).toEqual([11_000]);
    }
  });

  test("after 5 s of silence every 3 s", () => {
    const watch = online();
    watch.due(0, 0);
    watch.heard(100);
    watch.answered();
    expect(askedAt(watch, 200, 12_000)).toEqual([5100, 8100, 11_100]);
  });

  test("about every minute while all is well", () => {
    const watch = online();
    expect(askedAt(watch, 0, 125_000, (now_ms) => wellAt(watch, now_ms))).toEqual([0, 60_000, 120_000]);
  });

  test("beside numbered frames, which show what is missing, about every ten minutes", () => {
    const watch = online();
    const asked = askedAt(watch, 0, 1_300_000, (now_ms) => {
      wellAt(watch, now_ms);
      if (now_ms > 0) watch.framed();
    });
    expect(asked).toEqual([0, 60_000, 660_000, 1_260_000]);
  });

  test("a broker that was lost may bring another swarm, which sends no frames", () => {
    const watch = online();
    watch.due(0, 0);
    watch.framed();
    watch.broker("offline", 1000, 0);
    watch.broker("online", 100_000, 0);
    expect(askedAt(watch, 100_000, 165_000, (now_ms) => wellAt(watch, now_ms))).toEqual([100_000, 160_000]);
  });

  test("again after 3 s when the answer was lost, though frames come, and less and less often if nothing answers", () => {
    const watch = online();
    expect(askedAt(watch, 0, 40_000, (now_ms) => watch.heard(now_ms))).toEqual([0, 3000, 6000, 10_000, 18_000, 34_000]);
  });

  test("after a gap within half a second; of many gaps each asks half as often as the one before, until it is calm", () => {
    const watch = online();
    expect(askedAt(watch, 0, 2000, (now_ms) => wellAt(watch, now_ms))).toEqual([0]);
    watch.missed(2100, 0.9);
    expect(askedAt(watch, 2100, 4000, (now_ms) => wellAt(watch, now_ms))).toEqual([2600]);
    const gaps = (now_ms: number) => {
      wellAt(watch, now_ms);
      watch.missed(now_ms, 0);
    };
    expect(askedAt(watch, 40_000, 79_900, gaps)).toEqual([40_000, 41_000, 43_000, 47_000, 55_000, 71_000]);
    expect(askedAt(watch, 80_000, 110_000, (now_ms) => wellAt(watch, now_ms))).toEqual([87_000]);
    expect(askedAt(watch, 120_000, 121_900, gaps)).toEqual([120_000, 121_000]);
  });
});

describe("health", () => {
  test("connecting, then unreachable, then looking for the swarm, then live", () => {
    const watch = new Watch(0);
    expect(watch.health(100)).toEqual({ state: "connecting", broker: "away" });
    expect(state(watch.health(5000))).toBe("offline");
    watch.broker("online", 6000, 0);
    expect(watch.health(6000)).toEqual({ state: "connecting", broker: "reached" });
    watch.heard(6100);
    expect(state(watch.health(6100))).toBe("live");
    watch.broker("offline", 7000, 0);
    expect(state(watch.health(7000))).toBe("offline");
  });

  test("silent once a question had the time to be answered; live again at the first word", () => {
    const watch = online();
    expect(state(watch.health(6400))).toBe("connecting");
    expect(state(watch.health(6500))).toBe("silent");
    watch.heard(7000);
    expect(state(watch.health(7000))).toBe("live");
    expect(state(watch.health(13_499))).toBe("live");
    expect(state(watch.health(13_500))).toBe("silent");
  });

  test("late 800 ms after the last frame, where frames come; where none do, a swarm may be quiet", () => {
    const watch = online();
    watch.heard(1000);
    expect(state(watch.health(3000))).toBe("live");
    watch.framed();
    expect(state(watch.health(1799))).toBe("live");
    expect(state(watch.health(1800))).toBe("late");
    expect(state(watch.health(7500))).toBe("silent");
    watch.heard(7600);
    expect(state(watch.health(7600))).toBe("live");
  });

  test("heard, and never answered: told as that, until an answer; what comes back is waited for anew", () => {
    const watch = online();
    expect(watch.due(0, 0)).toBe(true);
    watch.heard(6400);
    expect(state(watch.health(6499))).toBe("live");
    expect(watch.due(6450, 0)).toBe(true);
    expect(state(watch.health(6500))).toBe("unanswered");
    watch.broker("offline", 6600, 0);
    watch.broker("online", 6700, 0);
    expect(watch.due(6700, 0)).toBe(true);
    watch.heard(13_100);
    expect(state(watch.health(13_199))).toBe("live");
    expect(state(watch.health(13_200))).toBe("unanswered");
    watch.answered();
    expect(state(watch.health(13_200))).toBe("live");
  });

  test("a device without a network is offline sooner, unless it hears a broker of its own", () => {
    const watch = online();
    watch.heard(1000);
    expect(watch.health(1399, false)).toEqual({ state: "live" });
    expect(watch.health(1400, false)).toEqual({ state: "offline", why: "network" });
  });

  test("a refused login is no broker out of reach", () => {
    const watch = new Watch(0);
    watch.broker("refused", 100, 0);
    expect(watch.health(100)).toEqual({ state: "offline", why: "login" });
    watch.broker("offline", 1100, 0);
    expect(watch.health(1100)).toEqual({ state: "offline", why: "broker" });
  });
});
