import { describe, expect, it } from "vitest";
import { extend, rate, type TotalsAt } from "./rates";

const at = (seconds: number, commands: number, uptime_s = seconds + 100): TotalsAt => ({
  at_ms: seconds * 1000,
  uptime_s,
  totals: { commands },
});

describe("rates", () => {
  it("are unknown until there are two samples", () => {
    expect(rate([], "commands")).toBeUndefined();
    expect(rate([at(0, 5)], "commands")).toBeUndefined();
  });

  it("are the growth over the window, per second", () => {
    expect(rate([at(0, 5), at(1, 9), at(4, 25)], "commands")).toBe(5);
  });

  it("count a reason that appears for the first time from zero", () => {
    const first = at(0, 0);
    const second: TotalsAt = { ...at(2, 0), totals: { stale: 6 } };
    expect(rate([first, second], "stale")).toBe(3);
  });

  it("forget what is older than ten seconds", () => {
    const window = [0, 1, 2, 11, 12].map((s) => at(s, s)).reduce<readonly TotalsAt[]>(extend, []);
    expect(window.map((sample) => sample.at_ms)).toEqual([2000, 11_000, 12_000]);
  });

  it("start anew with a gateway that started anew, and are never negative", () => {
    const window = extend([at(0, 900), at(1, 910)], at(2, 3, 0.5));
    expect(window).toHaveLength(1);
    expect(rate([at(0, 900), at(1, 3)], "commands")).toBe(0);
  });
});
