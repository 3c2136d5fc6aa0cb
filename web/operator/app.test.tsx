// @vitest-environment jsdom

import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { App } from "./app";

// jsdom has no canvas.
vi.mock("../map/map_view", () => ({ MapView: () => null }));

const TOKEN = "an-operator-token";
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

type Answer = () => Response | Promise<Response>;
const good: Answer = () => Response.json(STATE);
const gone: Answer = () => Promise.reject(new TypeError("failed to fetch"));

let answer: Answer = good;
let asked: { readonly url: string; readonly init: RequestInit }[] = [];
let root: Root | undefined;

beforeEach(() => {
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.useFakeTimers();
  answer = good;
  asked = [];
  vi.stubGlobal("fetch", (url: string, init: RequestInit) => {
    // The map's frames: they have tests of their own, and a real browser.
    if (url === "/api/frames") return new Promise(() => {});
    asked.push({ url, init });
    return Promise.resolve().then(answer);
  });
  // jsdom draws no images, so it has no URLs for them.
  URL.createObjectURL = () => "blob:code";
  URL.revokeObjectURL = () => undefined;
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

async function open(hash: string): Promise<void> {
  window.location.hash = hash;
  const place = document.body.appendChild(document.createElement("div"));
  root = createRoot(place);
  await act(async () => root?.render(<App />));
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
const page = () => document.documentElement.outerHTML;

describe("the operator page", () => {
  it("takes the token from the fragment, sends it as a header only, and shows neither it nor the pin", async () => {
    await open(`#token=${TOKEN}`);
    expect(window.location.href).not.toContain(TOKEN);
    expect(asked[0]?.url).toBe("/api/state");
    expect(asked[0]?.init.headers).toEqual({ Authorization: `Bearer ${TOKEN}` });
    expect(page()).not.toContain(TOKEN);
    expect(page()).not.toContain(PIN);
  });

  it("shows the code, the countdown, the broker, the visitors, the fleet and the refusals", async () => {
    await open(`#token=${TOKEN}`);
    expect(part("qr")?.querySelector("img")?.getAttribute("src")).toBe("blob:code");
    expect(part("countdown")?.textContent).toContain("10:11");
    expect(part("broker")?.textContent).toContain("ws://192.168.1.7:9001/mqtt");
    expect(part("visitors")?.textContent).toContain("mqttjs_1a2b");
    expect(part("fleet-table")?.textContent).toContain("Ada");
    expect(part("counters")?.querySelector('[data-counter="commands"]')?.textContent).toContain("12");
    expect(part("rejections")?.querySelectorAll("[data-reason]")).toHaveLength(1);
    expect(part("rejections")?.querySelector('[data-reason="stale"]')?.textContent).toContain("clock");
    expect(part("banner")).toBeNull();
  });

  it("keeps the token for a reload of the tab", async () => {
    await open(`#token=${TOKEN}`);
    act(() => root?.unmount());
    await open("");
    expect(part("qr")).not.toBeNull();
  });

  it("says what to do without a token, and asks nothing", async () => {
    await open("");
    expect(part("no-token")?.textContent).toContain("operator link printed in the terminal");
    await pass(5000);
    expect(asked).toHaveLength(0);
  });

  it("says what to do after a refusal, stops asking, and starts again with a new link", async () => {
    answer = () => new Response("", { status: 401 });
    await open("#token=an-old-one");
    expect(part("no-token")).not.toBeNull();
    await pass(5000);
    expect(asked).toHaveLength(1);
    answer = good;
    window.location.hash = `#token=${TOKEN}`;
    await act(async () => window.dispatchEvent(new HashChangeEvent("hashchange")));
    await pass(0);
    expect(part("qr")).not.toBeNull();
  });

  it("says that the gateway is gone, takes the code away, and recovers by itself", async () => {
    await open(`#token=${TOKEN}`);
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

  it("shows the shields and the refusals, and compromises the chosen robot with the token in a header", async () => {
    answer = () => Response.json({ ...STATE, shields: SHIELDS });
    await open(`#token=${TOKEN}`);
    expect(part("fleet-table")?.textContent).toContain("2/2 · 7 s");
    expect(part("refusals")?.textContent).toContain("Bo refused Cleo: output wrong");
    await choose("attack", "crash");
    expect(part("compromise")?.textContent).toContain("It does nothing.");
    asked = [];
    await act(async () => (part("compromise-button") as HTMLButtonElement).click());
    expect(asked, "nobody is chosen yet").toEqual([]);
    await choose("victim", "B0B0F00D33333333");
    answer = () => Response.json({ error: "too late" }, { status: 404 });
    await act(async () => (part("compromise-button") as HTMLButtonElement).click());
    await pass(0);
    expect(asked[0]?.url).toBe("/api/compromise");
    expect(asked[0]?.init).toMatchObject({ method: "POST", headers: { Authorization: `Bearer ${TOKEN}` } });
    expect(asked[0]?.init.body).toBe('{"address":"B0B0F00D33333333","attack":"crash"}');
    expect(part("compromise")?.querySelector('[role="alert"]')?.textContent).toBe("too late");
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
    answer = () => Response.json(state("", null));
    await open(`#token=${TOKEN}`);
    expect(part("lies")).toBeNull();
    await choose("victim", "B0B0F00D44444444");
    asked = [];
    const button = part("compromise-button") as HTMLButtonElement;
    await act(async () => button.click());
    await pass(0);
    await act(async () => button.click());
    expect(asked.map(({ url }) => url), "an impatient click").toEqual(["/api/compromise"]);
    answer = () => Response.json(state("hijack", { since_s: 3.4, stopped_after_s: null }));
    await pass(1000);
    expect(part("lies")?.textContent).toBe("Bo: hijack since 3 s");
    expect((part("victim") as HTMLSelectElement).value).toBe("");
    expect(button.disabled).toBe(true);
    answer = () => Response.json(state("hijack", { since_s: 20, stopped_after_s: 9.8 }));
    await pass(1000);
    expect(part("lies")?.textContent).toBe("Bo: hijack, stopped after 9.8 s");
  });

  it("stops all robots at a click, whatever the gateway last said, and lets them go again", async () => {
    await open(`#token=${TOKEN}`);
    expect(part("let-go")).toBeNull();
    answer = gone;
    await pass(7000);
    asked = [];
    await act(async () => (part("stop-all") as HTMLButtonElement).click());
    expect(asked[0]?.url).toBe("/api/stop");
    expect(asked[0]?.init).toMatchObject({ method: "POST", headers: { Authorization: `Bearer ${TOKEN}` } });
    await pass(0);
    expect(document.querySelector(".stop-all [role=alert]")?.textContent).toContain("does not answer");
    answer = () => Response.json({ ...STATE, held: true });
    await act(async () => (part("stop-all") as HTMLButtonElement).click());
    await pass(1000);
    expect(document.querySelector(".stop-all [role=alert]")).toBeNull();
    expect(document.querySelector(".stop-all")?.textContent).toContain("All robots are stopped");
    asked = [];
    await act(async () => (part("let-go") as HTMLButtonElement).click());
    expect(asked[0]?.url).toBe("/api/go");
    answer = good;
    await pass(1000);
    expect(part("let-go")).toBeNull();
  });

  it("greys a robot in Safe Mode, and does not offer it", async () => {
    const lie = { since_s: 60, stopped_after_s: 9 };
    const robots = { B0B0F00D33333333: { safe_mode: true, attack: "crash", lie, vouchers: [] } };
    answer = () => Response.json({ ...STATE, shields: { ...SHIELDS, robots } });
    await open(`#token=${TOKEN}`);
    expect(part("fleet-table")?.querySelector('[data-safe-mode="true"]')?.textContent).toContain("Safe Modecrash");
    expect((part("compromise-button") as HTMLButtonElement).disabled).toBe(true);
  });

  it("shows how far a mission is, and what a robot has learnt of its wheels", async () => {
    const walk = { phase: "seeking", decoded: 2, of: 5, why: "", drift: [29, -48, 0] };
    const mission = { world: "hall", running: null, robots: { B0B0F00D33333333: walk } };
    answer = () => Response.json({ ...STATE, mission });
    await open(`#token=${TOKEN}`);
    expect(part("fleet-table")?.textContent).toContain("seeking 2/5way +2.9 %, turns \u22124.8 %");
  });

  it("shows no volts of a robot that tells none", async () => {
    const [ada] = STATE.robots;
    answer = () =>
      Response.json({ ...STATE, robots: [ada, { ...ada, address: "B0B0F00D44444444", name: "Bo", battery_v: 0 }] });
    await open(`#token=${TOKEN}`);
    expect(part("fleet-table")?.textContent?.match(/\d V/g)).toHaveLength(1);
  });

  it("has no such button where robots do not audit each other", async () => {
    await open(`#token=${TOKEN}`);
    expect(part("compromise")).toBeNull();
    expect(part("refusals")).toBeNull();
    expect(part("unprotected")?.textContent).toContain("do not audit each other");
  });

  it("says why not, as phones do", async () => {
    answer = () => Response.json({ ...STATE, unprotected: "what audits need is being compiled" });
    await open(`#token=${TOKEN}`);
    expect(part("unprotected")?.textContent).toBe("No shieldsWhat audits need is being compiled.");
  });

  it("says which way phones are not let through", async () => {
    const phones = "phones get into ws://lab:9001/mqtt, but nothing on /qrkey/+/notify reaches them";
    answer = () => Response.json({ ...STATE, broker: { ...STATE.broker, phones } });
    await open(`#token=${TOKEN}`);
    expect(part("banner")?.textContent).toBe(`P${phones.slice(1)}`);
  });

  it("says that the broker is gone", async () => {
    answer = () => Response.json({ ...STATE, broker: { ...STATE.broker, connected: false, trouble: "Not authorized" } });
    await open(`#token=${TOKEN}`);
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
    const orders = () =>
      asked.filter(({ url }) => url !== "/api/state").map(({ url, init }) => `${url} ${init.body as string}`);

    beforeEach(() => {
      answer = () => Response.json({ ...STATE, mode: "session", overlapping: true, broker, visitors: [], session });
    });

    it("lists who is here with what each may do, and shows no broker", async () => {
      await open(`#token=${TOKEN}`);
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
      await open(`#token=${TOKEN}`);
      await click(row(3), "Let in");
      await click(row(1), "Watch only");
      await click(part("session"), "Close the door");
      await act(async () => (part("room-toggle") as HTMLButtonElement).click());
      expect(orders()).toEqual([
        '/api/link/approve {"visitor":3}',
        '/api/link/role {"visitor":1,"role":"watch"}',
        '/api/link/door {"open":false}',
        '/api/link/room {"show":true}',
      ]);
      answer = () => Response.json({ ...STATE, broker, session: { ...session, room: "12345678" } });
      await pass(1000);
      expect(part("room-digits")?.textContent).toBe("1234 5678");
    });

    it("gives a robot that is free, takes it, and exchanges two", async () => {
      const other = { ...STATE.robots[0], address: "B0B0F00D44444444", name: "Bo" };
      const visitors = [{ ...ada, robot: other.address }, bob, eve];
      const robots = [STATE.robots[0], other];
      answer = () => Response.json({ ...STATE, robots, broker, session: { ...session, visitors } });
      await open(`#token=${TOKEN}`);
      const give = async (id: number, value: string) => {
        const select = row(id)?.querySelector("select") as HTMLSelectElement;
        await act(async () => {
          select.value = value;
          select.dispatchEvent(new Event("change", { bubbles: true }));
        });
      };
      await give(1, "B0B0F00D33333333");
      await give(1, "");
      answer = () => Response.json({ ...STATE, robots, broker, session });
      await pass(1000);
      await give(1, "B0B0F00D44444444");
      expect(orders()).toEqual([
        '/api/link/swap {"robots":["B0B0F00D44444444","B0B0F00D33333333"]}',
        '/api/link/take {"robot":"B0B0F00D44444444"}',
        '/api/link/give {"visitor":1,"robot":"B0B0F00D44444444"}',
      ]);
    });

    it("removes only at a second click, and forgets the first one after a while", async () => {
      await open(`#token=${TOKEN}`);
      await click(row(1), "Remove");
      await click(part("session"), "Everybody out");
      expect(orders()).toEqual([]);
      await pass(5000);
      await click(row(1), "Remove");
      expect(orders()).toEqual([]);
      answer = () => Response.json({ error: "no visitor 1" }, { status: 409 });
      await click(row(1), "Really?");
      await pass(0);
      expect(orders()).toEqual(['/api/link/remove {"visitor":1}']);
      expect(part("session")?.querySelector("[role=alert]")?.textContent).toBe("no visitor 1");
    });
  });

  it("does not break on an answer that it does not understand", async () => {
    answer = () => Response.json({ ...STATE, robots: [{ name: "half a robot" }] });
    await open(`#token=${TOKEN}`);
    expect(part("banner")?.textContent).toContain("different versions");
  });

  it("shows the code alone, and leaves it with Escape", async () => {
    await open(`#token=${TOKEN}`);
    const button = () => document.querySelector<HTMLButtonElement>(".buttons button:last-child");
    await act(async () => button()?.click());
    expect(part("qr")).not.toBeNull();
    expect(part("fleet-table")).toBeNull();
    expect(document.activeElement).toBe(button());
    await act(async () => document.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" })));
    expect(part("fleet-table")).not.toBeNull();
  });
});
