// The constant rate: what each slot says, and that a stop comes first.

import { describe, expect, test } from "vitest";
import { type Saying, SLOT_MS, Slots } from "../client/session";

const A = "DECAFBAD00000001";

function command(name: string, robot = A): Saying {
  return { robot, name, say: () => {} };
}

/** What so many slots say, from `now_ms` on, with the wheels renewed before each. */
function said(slots: Slots, count: number, wheels?: Saying, now_ms = 0): string[] {
  return Array.from({ length: count }, (_, i) => {
    if (wheels) slots.hold(wheels, now_ms + i * SLOT_MS);
    const taken = slots.take(now_ms + i * SLOT_MS);
    return taken?.name ?? "alive";
  });
}

describe("slots", () => {
  test("nothing to say is said all the same", () => {
    expect(said(new Slots(), 3)).toEqual(["alive", "alive", "alive"]);
  });

  test("the newest wheels are said in every slot, and end by themselves when nobody renews them", () => {
    const slots = new Slots();
    slots.hold(command("slow"), 0);
    slots.hold(command("move_raw"), 0);
    expect(said(slots, 5)).toEqual(["move_raw", "move_raw", "move_raw", "alive", "alive"]);
  });

  test("a stop takes the next slot, is said once, and forgets what its robot was told before", () => {
    const slots = new Slots();
    slots.put(command("waypoints"));
    slots.put(command("rgb_led", "B"));
    slots.hold(command("move_raw"), 0);
    slots.stop(command("stop"));
    expect(slots.hasStop).toBe(true);
    expect(said(slots, 3)).toEqual(["stop", "rgb_led", "alive"]);
    expect(slots.hasStop).toBe(false);
  });

  test("who drives on within a slot is not stopped by the stop before", () => {
    const slots = new Slots();
    slots.stop(command("stop"));
    expect(said(slots, 2, command("move_raw"))).toEqual(["move_raw", "move_raw"]);
  });

  test("a stop of one robot leaves another's wheels alone", () => {
    const slots = new Slots();
    slots.hold(command("move_raw"), 0);
    slots.stop(command("stop", "B"));
    expect(said(slots, 2)).toEqual(["stop", "move_raw"]);
  });

  test("wheels keep two of three slots, whatever else is to be said", () => {
    const slots = new Slots();
    for (const name of ["a", "b", "c"]) slots.put(command(name));
    const all = said(slots, 10, command("move_raw"));
    expect(all.filter((each) => each !== "move_raw")).toEqual(["a", "b", "c"]);
    expect(all.join(" ")).not.toMatch(/[abc] [abc]/);
    expect(all.join(" ")).not.toMatch(/[abc] move_raw [abc]/);
  });

  test("of commands of one name the newest is said; and not more than can wait", () => {
    const slots = new Slots();
    const newest = command("rgb_led");
    slots.put(command("rgb_led"));
    slots.put(newest);
    expect(slots.take(0)).toBe(newest);
    expect(slots.take(0)).toBeUndefined();
    const taken = Array.from({ length: 100 }, (_, i) => slots.put(command(`c${i}`)));
    expect(taken.filter(Boolean)).toHaveLength(64);
  });

  test("what waited for a connection that was lost is never said", () => {
    const slots = new Slots();
    slots.put(command("rgb_led"));
    slots.hold(command("move_raw"), 0);
    slots.stop(command("stop", "B"));
    slots.clear();
    expect(said(slots, 2)).toEqual(["alive", "alive"]);
  });
});
