// The visitor page in a real browser, on an insecure origin, under the gateway's content security policy.

import type { Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, beforeEach, describe, expect, test, vi } from "vitest";
import { Pin, qrFragment } from "../../client";
import { Broker, haveBroker } from "./broker";
import { Browser, HOST, haveBrowser } from "./browser";
import { FakeSwarm, type Told } from "./fake_swarm";
import { Site } from "./site";

const P1 = "111111111111";
const P2 = "222222222222";

describe.skipIf(!haveBroker || !haveBrowser)("in a real browser", () => {
  let broker: Broker;
  let site: Site;
  let browser: Browser;
  let swarm: FakeSwarm;
  let page: Page;

  beforeAll(async () => {
    [broker, site, browser] = await Promise.all([Broker.start(), Site.start(), Browser.start()]);
  }, 60_000);
  afterAll(async () => {
    await browser.stop();
    await site.stop();
    await broker.stop();
  });
  beforeEach(() => {
    swarm = new FakeSwarm({ broker: broker.url, pin: P1, robots: 3 });
  });
  afterEach(async () => {
    swarm.stop();
    await page.close();
  });

  const home = () => `http://${HOST}:${site.port}/`;
  const broken = () => `ws://${HOST}:${broker.port}/mqtt`;
  const invite = (pin = P1) => home() + qrFragment({ pin: new Pin(pin), broker: broken(), root: "/qrkey", mqtt: 5 });
  const at = (id: string) => page.getByTestId(id);
  const state = () => at("badge").getAttribute("data-state");
  const becomes = (wanted: string, timeout = 8000) =>
    vi.waitFor(async () => expect(await state()).toBe(wanted), { timeout, interval: 100 });
  const commands = (name: string) => swarm.told.filter((told) => told.name === name);
  const wheels = ({ payload }: Told) => {
    const { left_y, right_y } = payload as { left_y: number; right_y: number };
    return [left_y, right_y];
  };

  async function join(url = invite()) {
    page = await browser.open(url);
    await becomes("live");
    await at("robot-select").selectOption({ index: 1 });
  }

  async function centreOf(id: string) {
    const box = await at(id).boundingBox();
    if (!box) throw new Error(`no ${id}`);
    return { x: box.x + box.width / 2, y: box.y + box.height / 2, ...{ width: box.width, height: box.height } };
  }

  /** After a release: one zero, and then nothing. */
  async function stopped() {
    await vi.waitFor(() => expect(wheels(commands("move_raw").at(-1) as Told)).toEqual([0, 0]));
    const count = commands("move_raw").length;
    await page.waitForTimeout(400);
    expect(commands("move_raw")).toHaveLength(count);
    expect(commands("move_raw").filter((told) => wheels(told).every((wheel) => wheel === 0))).toHaveLength(1);
  }

  test("joins where WebCrypto is hidden, shows the robots, and takes the pin out of the address", async () => {
    await join();
    expect(await page.evaluate(() => [isSecureContext, typeof crypto.subtle])).toEqual([false, "undefined"]);
    expect(page.url()).toBe(home());
    expect(await at("badge").textContent()).toBe("Live · 3 robots");
    const names = await at("robot-select").locator("option").allTextContents();
    const last4 = (i: number) => swarm.robots[i]?.address.slice(-4);
    expect(names).toEqual(["Choose a robot…", `Ada (${last4(0)})`, `Bo (${last4(1)})`, `Cleo (${last4(2)})`]);
  });

  test("a thumb on the joystick drives, and stops when lifted", async () => {
    await join();
    const touch = await page.context().newCDPSession(page);
    const { x, y } = await centreOf("joystick");
    await touch.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: [{ x, y: y - 50 }] });
    await touch.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: [{ x, y: y - 100 }] });
    await page.waitForTimeout(1000);
    await touch.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
    await stopped();
    const sent = commands("move_raw").map(wheels);
    expect(sent.filter(([left, right]) => left === 100 && right === 100).length).toBeGreaterThan(6);
    expect(sent.length).toBeLessThan(15);
    expect(commands("move_raw").every((told) => told.address === swarm.robots[0]?.address)).toBe(true);
    // The page did not scroll under the thumb.
    expect(await page.evaluate(() => window.scrollY)).toBe(0);
  });

  test("a hand taken away by the browser stops the robot", async () => {
    await join();
    const touch = await page.context().newCDPSession(page);
    const { x, y } = await centreOf("joystick");
    await touch.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: [{ x, y: y - 60 }] });
    await vi.waitFor(() => expect(commands("move_raw").length).toBeGreaterThan(2));
    await touch.send("Input.dispatchTouchEvent", { type: "touchCancel", touchPoints: [] });
    await stopped();
  });

  test("drives by keyboard alone, and stops when the focus leaves", async () => {
    await join();
    await at("joystick").focus();
    await page.keyboard.down("ArrowUp");
    await page.waitForTimeout(350);
    await page.keyboard.press("Tab");
    await page.waitForTimeout(100);
    await stopped();
    expect(wheels(commands("move_raw")[0] as Told)).toEqual([80, 80]);
  });

  test("lights the LED from the palette and from the colour field", async () => {
    await join();
    await page.getByRole("button", { name: "Light blue" }).click();
    await vi.waitFor(() => expect(commands("rgb_led").at(-1)?.payload).toEqual({ red: 47, green: 107, blue: 255 }));
    await at("led-colour").fill("#102030");
    await vi.waitFor(() => expect(commands("rgb_led").at(-1)?.payload).toEqual({ red: 16, green: 32, blue: 48 }));
    await vi.waitFor(async () => expect(await at("led-colour").inputValue()).toBe("#102030"));
  });

  test("a route: tapped, begun and cleared", async () => {
    await join();
    await at("route-toggle").click();
    const { x, y, height } = await centreOf("map");
    await page.touchscreen.tap(x, y);
    await page.touchscreen.tap(x, y + height / 4);
    await at("threshold").fill("100");
    await at("route-start").click();
    await vi.waitFor(() => expect(commands("waypoints")).toHaveLength(1));
    const route = commands("waypoints")[0]?.payload as {
      threshold: number;
      waypoints: { x: number; y: number; z: number }[];
    };
    expect(route.threshold).toBe(100);
    expect(route.waypoints).toHaveLength(2);
    // The map's middle is the area's middle, and down is down.
    expect(Math.abs((route.waypoints[0]?.x ?? 0) - 1000)).toBeLessThan(20);
    expect(Math.abs((route.waypoints[0]?.y ?? 0) - 1000)).toBeLessThan(20);
    expect(route.waypoints[1]?.y).toBeGreaterThan(1300);
    await at("route-clear").click();
    await vi.waitFor(() => expect(commands("waypoints").at(-1)?.payload).toEqual({ threshold: 100, waypoints: [] }));
  });

  test("a robot is chosen by tapping it", async () => {
    await join();
    const target = swarm.robots[1];
    const { x, y, width, height } = await centreOf("map");
    const [, mmX, mmY] = target?.row() ?? [];
    const scale = (Math.min(width, height) - 24) / 2000;
    await page.touchscreen.tap(x + (Number(mmX) - 1000) * scale, y + (Number(mmY) - 1000) * scale);
    await vi.waitFor(async () => expect(await at("robot-select").inputValue()).toBe(target?.address));
  });

  test("follows a rotation, and a reload goes on with the new pin", async () => {
    await join();
    swarm.rotate(P2);
    await page.waitForTimeout(500);
    await page.reload();
    await becomes("live");
    expect(await page.evaluate(() => sessionStorage.getItem("phalanx.invitation"))).toContain(P2);
  });

  test("scanning another swarm's code in the same tab goes there", async () => {
    const other = new FakeSwarm({ broker: broker.url, pin: P2, robots: 5 });
    await join();
    await page.goto(invite(P2));
    await vi.waitFor(async () => expect(await at("badge").textContent()).toBe("Live · 5 robots"), 5000);
    expect(page.url()).toBe(home());
    other.stop();
  });

  test("without a code it says so, and a pasted link joins", async () => {
    page = await browser.open(home());
    expect(await state()).toBe("nocode");
    await at("link").fill("hello");
    await at("link-join").click();
    expect(await page.getByRole("alert").textContent()).toContain("no pin");
    await at("link").fill(
      `https://elsewhere.example/?use_qrkey=true&pin=${P1}&mqtt_host=${HOST}&mqtt_port=${broker.port}&mqtt_version=5&mqtt_use_ssl=False`,
    );
    await at("link-join").click();
    await becomes("live");
  });

  test("drives an older server's robots on a unit square", async () => {
    swarm.stop();
    swarm = new FakeSwarm({ broker: broker.url, pin: P1, robots: 2, frames: false });
    await join();
    await at("route-toggle").click();
    const { x, y } = await centreOf("map");
    await page.touchscreen.tap(x, y);
    await at("route-start").click();
    await vi.waitFor(() => expect(commands("waypoints")).toHaveLength(1));
    const { waypoints } = (commands("waypoints")[0] as Told).payload as { waypoints: { x: number; y: number }[] };
    expect(waypoints[0]?.x).toBeCloseTo(0.5, 1);
    expect(waypoints[0]?.y).toBeCloseTo(0.5, 1);
  });

  test("every button is large enough for a thumb, and nothing is wider than the phone", async () => {
    await join();
    await at("route-toggle").click();
    const small = await page.locator("button:visible, select:visible, input:visible").evaluateAll((elements) =>
      elements
        .map((element) => ({ box: element.getBoundingClientRect(), html: element.outerHTML.slice(0, 80) }))
        .filter(({ box }) => box.height < 44 || box.width < 44)
        .map(({ html }) => html),
    );
    expect(small).toEqual([]);
    expect(await page.evaluate(() => document.documentElement.scrollWidth)).toBe(390);
  });

  test("stays smooth with 200 robots at 10 Hz", async () => {
    swarm.stop();
    swarm = new FakeSwarm({ broker: broker.url, pin: P1, robots: 200 });
    await join();
    const frames = await page.evaluate(
      () =>
        new Promise<number>((resolve) => {
          const begin = performance.now();
          let count = 0;
          const next = () => {
            count += 1;
            if (performance.now() - begin < 3000) requestAnimationFrame(next);
            else resolve(count / 3);
          };
          requestAnimationFrame(next);
        }),
    );
    // Without a graphics card, on a shared machine: a phone does better.
    expect(frames).toBeGreaterThan(20);
    await vi.waitFor(async () => expect(await at("badge").textContent()).toBe("Live · 200 robots"), { timeout: 5000 });
  });

  test("nothing was complained of: no policy refused anything, nothing failed to load", () => {
    expect(browser.complaints).toEqual([]);
  });
});
