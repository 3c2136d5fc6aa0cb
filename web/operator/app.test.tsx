// @vitest-environment jsdom

import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { type Json, NO_SWARM, NO_VISIT, Refused, Unanswered } from "../client";
import { Desk } from "./app";
import { order, type Station } from "./station";

// jsdom has no canvas.
vi.mock("../map/map_view", () => ({ MapView: () => null }));

const PIN = "314159265358979323846264338327950288419";

const STATE = {
  mode: "qrkey",
  page_url: "http://192.168.1.7:8080/",
  qr_url: `http://192.168.1.7:8080/#v=1&pin=${PIN}`,
  qr_svg: '<svg viewBox="0 0 9 9"><path d="M4 4h1"/></svg>',
  rotates_in_s: 610.2,
  rotate_s: 900,
  overlap_s: 120,
  overlapping: false,
  uptime_s: 290,
  broker: { name: "mosquitto", url: "ws://192.168.1.7:9001/mqtt", connected: true },
  visitors: [{ id: "mqttjs_1a2b", last_seen_s: 2, requests: 4 }],
  robots: [
    {
      address: "B0B0F00D33333333",
      name: "Ada",
      status: 0,
      mode: 1,
      battery_v: 2.7,
      last_seen_s: 0.2,
      rgb_led: { red: 255, green: 0, blue: 0 },
      link: "ok",
    },
  ],
  shields: null,
  mission: null,
  counters: { commands: 12, requests: 4, notifications: 90, knocks: 0, reconnects: 0 },
  rejected: { stale: 3, replayed: 0 },
};

const SHIELDS = {
  tokens_needed: 2,
  t_val_ms: 10_000,
  attacks: [
    { name: "hijack", does: "drives as it likes" },
    { name: "crash", does: "does nothing" },
  ],
  refusals: [{ ago_s: 2, auditor: "Bo", auditee: "Cleo", reason: "output wrong" }],
  robots: {
    B0B0F00D33333333: {
      safe_mode: false,
      attack: "",
      lie: null,
      vouchers: [
        { name: "Bo", left_s: 8.1 },
        { name: "Cleo", left_s: 6.2 },
      ],
    },
  },
};

type Answer = () => unknown;
const good: Answer = () => STATE;
const gone: Answer = () => Promise.reject(new Unanswered("no answer"));

let answer: Answer = good;
/** What was asked beside the state. */
let asked: string[] = [];
let root: Root | undefined;
const station: Station = {
  source: { view: { swarm: NO_SWARM, health: { state: "live" }, visit: NO_VISIT }, subscribe: () => () => {} },
  hold: (held) => order(station, held ? "stop" : "go"),
  ask: (what, words = {}) => {
    if (what !== "state") asked.push(`${what} ${JSON.stringify(words)}`);
    return Promise.resolve().then(answer) as Promise<Json>;
  },
};

beforeEach(() => {
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.useFakeTimers();
  answer = good;
  asked = [];
  window.sessionStorage.clear();
  window.history.replaceState(null, "", "/");
});

afterEach(() => {
  act(() => root?.unmount());
  root = undefined;
  document.body.replaceChildren();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

async function open(): Promise<void> {
  const place = document.body.appendChild(document.createElement("div"));
  root = createRoot(place);
  await act(async () => root?.render(<Desk station={station} isOnTablet={false} />));
  await pass(0);
}

async function pass(ms: number): Promise<void> {
  await act(async () => {
    await vi.advanceTimersByTimeAsync(ms);
  });
}

async function choose(id: string, value: string): Promise<void> {
  const select = part(id) as HTMLSelectElement;
  await act(async () => {
    select.value = value;
    select.dispatchEvent(new Event("change", { bubbles: true }));
  });
}

const part = (id: string) => document.querySelector(`[data-testid="${id}"]`);

describe("the operator page", () => {
  it("does not show the pin", async () => {
    await open();
    expect(part("qr")).not.toBeNull();
    expect(document.body.textContent).not.toContain(PIN);
  });

  it("shows the code, the countdown, the broker, the visitors, the fleet and the refusals", async () => {
    await open();
    expect(part("qr")?.querySelector("img")?.getAttribute("src")).toContain(encodeURIComponent("M4 4h1"));
    expect(part("countdown")?.textContent).toContain("10:11");
    expect(part("broker")?.textContent).toContain("ws://192.168.1.7:9001/mqtt");
    expect(part("visitors")?.textContent).toContain("mqttjs_1a2b");
    expect(part("fleet-table")?.textContent).toContain("Ada");
    expect(part("counters")?.querySelector('[data-counter="commands"]')?.textContent).toContain("12");
    expect(part("rejections")?.querySelectorAll("[data-reason]")).toHaveLength(1);
    expect(part("rejections")?.querySelector('[data-reason="stale"]')?.textContent).toContain("clock");
    expect(part("banner")).toBeNull();
  });

  it("says that the gateway is gone, takes the code away, and recovers by itself", async () => {
    await open();
    answer = gone;
    await pass(2000);
    expect(part("banner")?.textContent).toContain("Gateway not answering, retrying");
    expect(part("qr")?.getAttribute("data-out-of-order")).toBe("false");
    await pass(6000);
    expect(part("qr")?.getAttribute("data-out-of-order")).toBe("true");
    answer = good;
    await pass(2000);
    expect(part("banner")).toBeNull();
    expect(part("qr")?.getAttribute("data-out-of-order")).toBe("false");
  });

  it("shows the shields and the refusals, and compromises the chosen robot", async () => {
    answer = () => ({ ...STATE, shields: SHIELDS });
    await open();
    expect(part("fleet-table")?.textContent).toContain("2/2 · 7 s");
    expect(part("refusals")?.textContent).toContain("Bo refused Cleo: output wrong");
    await choose("attack", "crash");
    expect(part("compromise")?.textContent).toContain("It does nothing.");
    asked = [];
    await act(async () => (part("compromise-button") as HTMLButtonElement).click());
    expect(asked, "nobody is chosen yet").toEqual([]);
    await choose("victim", "B0B0F00D33333333");
    answer = () => Promise.reject(new Refused("unknown"));
    await act(async () => (part("compromise-button") as HTMLButtonElement).click());
    await pass(0);
    expect(asked).toEqual(['compromise {"address":"B0B0F00D33333333","attack":"crash"}']);
    expect(part("compromise")?.querySelector('[role="alert"]')?.textContent).toContain("knows no such");
  });

  it("says whom it compromised and when that was stopped, and chooses nobody in its place", async () => {
    const [honest] = STATE.robots;
    const robots = [honest, { ...honest, address: "B0B0F00D44444444", name: "Bo" }];
    const state = (attack: string, lie: object | null) => ({
      ...STATE,
      robots,
      shields: {
        ...SHIELDS,
        robots: { ...SHIELDS.robots, B0B0F00D44444444: { safe_mode: false, attack, lie, vouchers: [] } },
      },
    });
    answer = () => state("", null);
    await open();
    expect(part("lies")).toBeNull();
    await choose("victim", "B0B0F00D44444444");
    asked = [];
    const button = part("compromise-button") as HTMLButtonElement;
    await act(async () => button.click());
    await pass(0);
    await act(async () => button.click());
    expect(asked, "an impatient click").toHaveLength(1);
    answer = () => state("hijack", { since_s: 3.4, stopped_after_s: null });
    await pass(1000);
    expect(part("lies")?.textContent).toBe("Bo: hijack since 3 s");
    expect((part("victim") as HTMLSelectElement).value).toBe("");
    expect(button.disabled).toBe(true);
    answer = () => state("hijack", { since_s: 20, stopped_after_s: 9.8 });
    await pass(1000);
    expect(part("lies")?.textContent).toBe("Bo: hijack, stopped after 9.8 s");
  });

  it("stops all robots at a click, whatever the gateway last said, and lets them go again", async () => {
    await open();
    expect(part("let-go")).toBeNull();
    answer = gone;
    await pass(7000);
    asked = [];
    await act(async () => (part("stop-all") as HTMLButtonElement).click());
    expect(asked).toEqual(["stop {}"]);
    await pass(0);
    expect(document.querySelector(".stop-all [role=alert]")?.textContent).toContain("does not answer");
    answer = () => ({ ...STATE, held: true });
    await act(async () => (part("stop-all") as HTMLButtonElement).click());
    await pass(1000);
    expect(document.querySelector(".stop-all [role=alert]")).toBeNull();
    expect(document.querySelector(".stop-all")?.textContent).toContain("All robots are stopped");
    asked = [];
    await act(async () => (part("let-go") as HTMLButtonElement).click());
    expect(asked).toEqual(["go {}"]);
    answer = good;
    await pass(1000);
    expect(part("let-go")).toBeNull();
  });

  it("greys a robot in Safe Mode, and does not offer it", async () => {
    const lie = { since_s: 60, stopped_after_s: 9 };
    const robots = { B0B0F00D33333333: { safe_mode: true, attack: "crash", lie, vouchers: [] } };
    answer = () => ({ ...STATE, shields: { ...SHIELDS, robots } });
    await open();
    expect(part("fleet-table")?.querySelector('[data-safe-mode="true"]')?.textContent).toContain("Safe Modecrash");
    expect((part("compromise-button") as HTMLButtonElement).disabled).toBe(true);
  });

  it("revives a robot that was stopped, once for each click, and says why it could not", async () => {
    const robots = { B0B0F00D33333333: { safe_mode: true, attack: "crash", lie: null, vouchers: [] } };
    answer = () => ({ ...STATE, shields: { ...SHIELDS, robots } });
    await open();
    expect(part("stopped"), "real robots are revived by hand").toBeNull();
    answer = () => ({ ...STATE, shields: { ...SHIELDS, robots, revives: true } });
    await pass(1000);
    const button = part("stopped")?.querySelector("button") as HTMLButtonElement;
    expect(button.textContent).toBe("Revive Ada");
    asked = [];
    await act(async () => button.click());
    await act(async () => button.click());
    expect(asked).toEqual(['revive {"robot":"B0B0F00D33333333"}']);
    expect(button.disabled, "it begins anew in some seconds").toBe(true);
    await pass(8000);
    expect(button.disabled).toBe(false);
    expect(part("stopped")?.querySelector("[role=alert]")).toBeNull();
    answer = () => Promise.reject(new Refused("not_allowed"));
    await act(async () => button.click());
    await pass(0);
    expect(part("stopped")?.querySelector("[role=alert]")?.textContent).toContain("not allowed");
    expect(button.disabled, "it can be tried again at once").toBe(false);
    answer = () => ({ ...STATE, shields: { ...SHIELDS, revives: true } });
    await pass(1000);
    expect(part("stopped")).toBeNull();
  });

  it("shows how far a mission is, and what a robot has learnt of its wheels", async () => {
    const walk = { phase: "seeking", decoded: 2, of: 5, why: "", drift: [29, -48, 0] };
    const mission = { world: "hall", running: null, robots: { B0B0F00D33333333: walk } };
    answer = () => ({ ...STATE, mission });
    await open();
    expect(part("fleet-table")?.textContent).toContain("searching 2/5odometry scale error +2.9 %, turn error \u22124.8 %");
  });

  it("shows no volts of a robot that tells none", async () => {
    const [ada] = STATE.robots;
    answer = () =>
      ({ ...STATE, robots: [ada, { ...ada, address: "B0B0F00D44444444", name: "Bo", battery_v: 0 }] });
    await open();
    expect(part("fleet-table")?.textContent?.match(/\d V/g)).toHaveLength(1);
  });

  it("has no such button where robots do not audit each other", async () => {
    await open();
    expect(part("compromise")).toBeNull();
    expect(part("refusals")).toBeNull();
    expect(part("unprotected")?.textContent).toContain("do not audit each other");
  });

  it("says why not, as phones do", async () => {
    answer = () => ({ ...STATE, unprotected: "what audits need is being compiled" });
    await open();
    expect(part("unprotected")?.textContent).toBe("No shieldsWhat audits need is being compiled.");
  });

  it("says which way phones are not let through", async () => {
    const phones = "phones get into ws://lab:9001/mqtt, but nothing on /qrkey/+/notify reaches them";
    answer = () => ({ ...STATE, broker: { ...STATE.broker, phones } });
    await open();
    expect(part("banner")?.textContent).toBe(`P${phones.slice(1)}`);
  });

  it("says that the broker is gone", async () => {
    answer = () => ({ ...STATE, broker: { ...STATE.broker, connected: false, trouble: "Not authorized" } });
    await open();
    expect(part("banner")?.textContent).toContain("lost its broker (Not authorized), retrying");
    expect(part("broker")?.getAttribute("data-connected")).toBe("false");
  });

  describe("of sessions", () => {
    const ada = { visitor: 1, name: "Ada L.", role: "drive", waiting: false, present: true, robot: "", place: 0 };
    const bob = { ...ada, visitor: 2, name: "Bob", robot: "B0B0F00D33333333" };
    const eve = { ...ada, visitor: 3, name: "Eve", waiting: true };
    const session = { room: null as string | null, open: true, visitors: [ada, bob, eve] };
    const broker = { name: "direct", url: "", connected: true };
    const row = (id: number) => document.querySelector(`[data-visitor="${id}"]`);
    const click = async (where: Element | null | undefined, label: string) => {
      const button = [...(where?.querySelectorAll("button") ?? [])].find(({ textContent }) => textContent === label);
      await act(async () => button?.click());
    };

    beforeEach(() => {
      answer = () => ({ ...STATE, mode: "session", overlapping: true, broker, visitors: [], session });
    });

    it("lists who is here with what each may do, and shows no broker", async () => {
      await open();
      expect(part("broker")).toBeNull();
      expect(part("visitors")).toBeNull();
      expect(row(1)?.textContent).toContain("Ada L.drive");
      expect(row(3)?.textContent).toContain("Evewaits");
      expect(row(3)?.querySelector("select")).toBeNull();
      expect((row(2)?.querySelector("select") as HTMLSelectElement).value).toBe("B0B0F00D33333333");
      // The one before is refused at once, so there is nothing to wait for.
      expect((part("new-code") as HTMLButtonElement).disabled).toBe(false);
    });

    it("lets in, changes roles, shows a room code, and closes the door", async () => {
      await open();
      await click(row(3), "Let in");
      await click(row(1), "Watch only");
      await click(part("session"), "Close the door");
      await act(async () => (part("room-toggle") as HTMLButtonElement).click());
      expect(asked).toEqual([
        'approve {"visitor":3}',
        'role {"visitor":1,"role":"watch"}',
        'door {"open":false}',
        'room {"show":true}',
      ]);
      answer = () => ({ ...STATE, broker, session: { ...session, room: "12345678" } });
      await pass(1000);
      expect(part("room-digits")?.textContent).toBe("1234 5678");
    });

    it("gives a robot that is free, takes it, and exchanges two", async () => {
      const other = { ...STATE.robots[0], address: "B0B0F00D44444444", name: "Bo" };
      const visitors = [{ ...ada, robot: other.address }, bob, eve];
      const robots = [STATE.robots[0], other];
      answer = () => ({ ...STATE, robots, broker, session: { ...session, visitors } });
      await open();
      const give = async (id: number, value: string) => {
        const select = row(id)?.querySelector("select") as HTMLSelectElement;
        await act(async () => {
          select.value = value;
          select.dispatchEvent(new Event("change", { bubbles: true }));
        });
      };
      await give(1, "B0B0F00D33333333");
      await give(1, "");
      answer = () => ({ ...STATE, robots, broker, session });
      await pass(1000);
      await give(1, "B0B0F00D44444444");
      expect(asked).toEqual([
        'swap {"robots":["B0B0F00D44444444","B0B0F00D33333333"]}',
        'take {"robot":"B0B0F00D44444444"}',
        'give {"visitor":1,"robot":"B0B0F00D44444444"}',
      ]);
    });

    it("removes only at a second click, and forgets the first one after a while", async () => {
      await open();
      await click(row(1), "Remove");
      await click(part("session"), "Everybody out");
      expect(asked).toEqual([]);
      await pass(5000);
      await click(row(1), "Remove");
      expect(asked).toEqual([]);
      answer = () => Promise.reject(new Refused("unknown"));
      await click(row(1), "Really?");
      await pass(0);
      expect(asked).toEqual(['remove {"visitor":1}']);
      expect(part("session")?.querySelector("[role=alert]")?.textContent).toContain("knows no such");
    });
  });

  it("does not break on an answer that it does not understand", async () => {
    answer = () => ({ ...STATE, robots: [{ name: "half a robot" }] });
    await open();
    expect(part("banner")?.textContent).toContain("different versions");
  });

  it("shows the code alone, and leaves it with Escape", async () => {
    await open();
    const button = () => document.querySelector<HTMLButtonElement>(".buttons button:last-child");
    await act(async () => button()?.click());
    expect(part("qr")).not.toBeNull();
    expect(part("fleet-table")).toBeNull();
    expect(document.activeElement).toBe(button());
    await act(async () => document.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" })));
    expect(part("fleet-table")).not.toBeNull();
  });
});
