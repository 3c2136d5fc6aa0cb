// The page's logic without a page: driving, the badge's words, the map's geometry, where the invitation is kept.

import fc from "fast-check";
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { type Area, Secret, sessionFragment } from "../client";
import { badgeWords, hostOf, type Where } from "../visitor/badge";
import { clampStick, Drive, stickOfKeys, type Wheels, wheels } from "../visitor/drive";
import { forgetCode, keepCode, readLink, type Surroundings, takeFromAddress, takeKept } from "../visitor/invitation_store";
import { hexOf, rgbOf } from "../visitor/led";
import { Motion } from "../map/motion";
import { fitArea, gridStep, nearest, toArea, toScreen } from "../map/projection";
import { routePayload } from "../visitor/route";

describe("wheels", () => {
  test("forward, back and turning on the spot", () => {
    expect(wheels({ x: 0, y: 1 })).toEqual({ left: 100, right: 100 });
    expect(wheels({ x: 0, y: -0.5 })).toEqual({ left: -50, right: -50 });
    expect(wheels({ x: 1, y: 0 })).toEqual({ left: 100, right: -100 });
    expect(wheels({ x: 0.05, y: 0.05 })).toEqual({ left: 0, right: 0 });
  });

  test("are whole numbers within 100, and turn to the side that was meant", () => {
    const axis = fc.double({ min: -1, max: 1, noNaN: true });
    fc.assert(
      fc.property(axis, axis, (x, y) => {
        const { left, right } = wheels(clampStick({ x, y }));
        for (const wheel of [left, right]) {
          expect(Number.isInteger(wheel) && Math.abs(wheel) <= 100 && !Object.is(wheel, -0)).toBe(true);
        }
        if (x > 0.2) expect(left).toBeGreaterThan(right);
      }),
    );
  });

  test("keys add up, and opposite ones cancel", () => {
    expect(stickOfKeys(new Set(["ArrowUp", "KeyD"]))).toEqual({ x: 0.4, y: 0.8 });
    expect(stickOfKeys(new Set(["KeyW", "KeyS"]))).toEqual({ x: 0, y: 0 });
    expect(stickOfKeys(new Set(["KeyQ", "toString"]))).toBeUndefined();
  });
});

describe("drive", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  function driven() {
    const sent: Wheels[] = [];
    return { sent, drive: new Drive((command) => void sent.push(command)) };
  }

  test("sends at once, every 100 ms while held, and one zero at the end", () => {
    const { sent, drive } = driven();
    drive.hold({ x: 0, y: 1 });
    expect(sent).toHaveLength(1);
    vi.advanceTimersByTime(450);
    expect(sent).toHaveLength(5);
    drive.release();
    expect(sent.at(-1)).toEqual({ left: 0, right: 0 });
    vi.advanceTimersByTime(2000);
    expect(sent).toHaveLength(6);
  });

  test("each change is sent at once, and the newest is repeated", () => {
    const { sent, drive } = driven();
    for (const y of [0.2, 0.5, 1]) drive.hold({ x: 0, y });
    expect(sent.map(({ left }) => left)).toEqual([20, 50, 100]);
    vi.advanceTimersByTime(100);
    expect(sent.slice(3)).toEqual([{ left: 100, right: 100 }]);
  });

  test("releasing what is not held says nothing", () => {
    const { sent, drive } = driven();
    drive.release();
    drive.hold({ x: 0, y: 1 });
    drive.release();
    drive.release();
    expect(sent).toHaveLength(2);
  });
});

describe("badge", () => {
  test("says in plain words what is wrong", () => {
    const broker: Where = { via: "broker", host: "swarm:9001" };
    const words = (health: Parameters<typeof badgeWords>[0], robots = 3) => badgeWords(health, broker, robots).text;
    expect(words({ state: "offline", why: "broker" })).toBe("No connection to swarm:9001. Trying again… If that lasts, scan the code again.");
    expect(words({ state: "offline", why: "network" })).toContain("no network");
    expect(words({ state: "offline", why: "login" })).toContain("swarm:9001 wants a password");
    expect(words({ state: "late" })).toContain("Controls are off");
    expect(badgeWords({ state: "live" }, broker, 3, true)).toMatchObject({ state: "held" });
    expect(badgeWords({ state: "silent" }, broker, 3, true)).toMatchObject({ state: "silent" });
    expect(words({ state: "silent" })).toContain("Scan its code again");
    expect(words({ state: "unanswered" })).toContain("does not answer");
    expect([words({ state: "live" }), words({ state: "live" }, 1)]).toEqual(["Live · 3 robots", "Live · 1 robot"]);
  });

  test("names the broker's host and port", () => {
    expect(hostOf("ws://192.168.1.7:9001/mqtt")).toBe("192.168.1.7:9001");
    expect(hostOf("wss://broker.example/mqtt")).toBe("broker.example:443");
    expect(hostOf("ws://[::1]/mqtt")).toBe("[::1]:80");
  });
});

describe("map", () => {
  const mm: Area = { width: 3000, height: 2000 };

  test("a tap on a place of the map means that place", () => {
    const size = fc.integer({ min: 100, max: 2000 });
    fc.assert(
      fc.property(size, size, fc.integer({ min: 0, max: 3000 }), fc.integer({ min: 0, max: 2000 }), (w, h, x, y) => {
        const p = fitArea(mm, w, h);
        expect(toArea(p, toScreen(p, { x, y }))).toEqual({ x, y });
        const { x: px, y: py } = toScreen(p, { x, y });
        expect(px >= 0 && px <= w && py >= 0 && py <= h).toBe(true);
      }),
    );
  });

  test("a tap beside the area means its edge", () => {
    expect(toArea(fitArea(mm, 300, 300), { x: -50, y: 9999 })).toEqual({ x: 0, y: 2000 });
  });

  test("the grid has round steps", () => {
    expect([gridStep(mm), gridStep({ width: 9000, height: 100 })]).toEqual([500, 2000]);
  });

  test("a tap takes the nearest robot within reach", () => {
    const places = new Map([
      ["a", { x: 10, y: 10 }],
      ["b", { x: 30, y: 10 }],
    ]);
    expect(nearest(places, { x: 22, y: 10 }, 28)).toBe("b");
    expect(nearest(places, { x: 200, y: 10 }, 28)).toBeUndefined();
  });

  test("robots glide to where they are said to be, arrive, and jump only when carried", () => {
    const motion = new Motion();
    const aim = (x: number, still = false) => motion.aim(new Map([["a", { x, y: 0 }]]), still);
    const at = () => motion.places.get("a")?.x ?? Number.NaN;
    aim(0);
    aim(20);
    expect(motion.advance(16)).toBe(true);
    expect(at() > 0 && at() < 20).toBe(true);
    for (let i = 0; i < 100; i += 1) motion.advance(16);
    expect([at(), motion.advance(16)]).toEqual([20, false]);
    aim(500);
    expect(at()).toBe(500);
    aim(490, true);
    expect(at()).toBe(490);
    motion.aim(new Map(), false);
    expect(motion.places.size).toBe(0);
  });
});

describe("colours and routes", () => {
  test("a colour field's value becomes the payload, and back", () => {
    expect(rgbOf("#ff8a00")).toEqual({ red: 255, green: 138, blue: 0 });
    expect(hexOf({ red: 1, green: 20, blue: 255 })).toBe("#0114ff");
    expect(hexOf(undefined)).toBe("#000000");
  });

  test("waypoints carry the z without which PyDotBot refuses them", () => {
    expect(routePayload(50, [{ x: 1, y: 2 }])).toEqual({ threshold: 50, waypoints: [{ x: 1, y: 2, z: 0 }] });
  });
});

describe("invitation", () => {
  function tab(href: string, stored = new Map<string, string>()) {
    const location = { href };
    const at: Surroundings = {
      location,
      history: {
        replaceState: (_data, _unused, url) => {
          location.href = new URL(url, location.href).href;
        },
      },
      storage: {
        getItem: (key) => stored.get(key) ?? null,
        setItem: (key, value) => void stored.set(key, value),
        removeItem: (key) => void stored.delete(key),
      },
    };
    return { at, location, stored };
  }

  test("of a session is taken from the fragment, and kept until it has admitted us", () => {
    const code = { fixed: new Uint8Array(32), secret: new Secret("open", new Uint8Array(16)), broker: "", root: "", mqtt: 0 };
    const { at, location, stored } = tab(`http://swarm:8080/#${sessionFragment(code)}`);
    const taken = takeFromAddress(at)?.code;
    expect(taken?.secret.kind).toBe("open");
    expect(location.href).toBe("http://swarm:8080/");
    if (!taken) throw new Error("nothing taken");
    keepCode(at, taken);
    expect(takeKept(tab("http://swarm:8080/", stored).at).code?.fixed).toEqual(code.fixed);
    forgetCode(at);
    expect(takeKept(at)).toEqual({});
    const brokered = sessionFragment({ ...code, broker: "ws://h:9001", root: "/r", mqtt: 5 });
    expect(takeFromAddress(tab(`http://swarm:8080/#${brokered}`).at)?.code).toMatchObject({ broker: "ws://h:9001", root: "/r", mqtt: 5 });
    expect(takeFromAddress(tab("http://swarm:8080/#j=cut").at)?.problem).toMatch(/cut off/);
  });

  test("an address without one is left alone", () => {
    const { at, location } = tab("http://swarm:8080/#help");
    expect(takeFromAddress(at)).toBeUndefined();
    expect(location.href).toBe("http://swarm:8080/#help");
  });

  test.each(["#v=1&pin=123456789012&broker=ws%3A%2F%2Fh%2Fmqtt", "#user=guest&password=secret"])(
    "a link for programs is refused, and leaves nothing in the address: %s",
    (fragment) => {
      const { at, location } = tab(`http://swarm:8080/?lang=en${fragment}`);
      expect(takeFromAddress(at)?.problem).toMatch(/not the link under a QR code/);
      expect(location.href).toBe("http://swarm:8080/?lang=en");
    },
  );

  test("what is pasted is refused in plain words", () => {
    expect(readLink("hello").problem).toMatch(/not the link/);
    expect(readLink("http://swarm/#j=AAAA").problem).toMatch(/cut off/);
  });

  test("a storage that is full, forbidden or spoilt costs no more than a scan", () => {
    const { at } = tab("http://swarm:8080/", new Map([["phalanx.code", "j=spoilt"]]));
    expect(takeKept(at)).toEqual({});
    const refuse = () => {
      throw new Error("full");
    };
    const full: Surroundings = { ...at, storage: { getItem: refuse, setItem: refuse, removeItem: refuse } };
    expect(takeKept(full)).toEqual({});
    const code = { fixed: new Uint8Array(32), secret: new Secret("open", new Uint8Array(16)), broker: "", root: "", mqtt: 0 };
    for (const storage of [full, { ...at, storage: undefined }]) {
      expect(() => keepCode(storage, code)).not.toThrow();
      expect(() => forgetCode(storage)).not.toThrow();
    }
  });
});
