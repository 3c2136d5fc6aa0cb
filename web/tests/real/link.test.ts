// The connection and the swarm's state over a real mosquitto.

import { type ChildProcess, spawn } from "node:child_process";
import { createInterface } from "node:readline";
import { afterAll, afterEach, beforeAll, describe, expect, test, vi } from "vitest";
import { type Invitation, Pin, qrFragment, SwarmLink, Unanswered } from "../../client";
import { Connection } from "../../client/io/connection";
import { Broker, freePort, haveBroker } from "./broker";
import { FakeSwarm } from "./fake_swarm";

const P1 = "111111111111";
const P2 = "222222222222";
const P3 = "333333333333";

describe.skipIf(!haveBroker)("over a real broker", () => {
  let broker: Broker;
  const opened: { close?: () => void; stop?: () => void }[] = [];

  beforeAll(async () => {
    broker = await Broker.start();
  });
  afterEach(() => {
    for (const thing of opened.splice(0)) (thing.close ?? thing.stop)?.call(thing);
  });
  afterAll(() => broker.stop());

  const to = (pin = P1, mqtt: 4 | 5 = 5): Invitation => ({
    pin: new Pin(pin),
    broker: broker.url,
    root: "/qrkey",
    mqtt,
  });

  function swarm(options: Partial<ConstructorParameters<typeof FakeSwarm>[0]> = {}): FakeSwarm {
    const made = new FakeSwarm({ broker: broker.url, pin: P1, robots: 3, ...options });
    opened.push(made);
    return made;
  }

  function join(invitation = to(), onMoved?: (pin: Pin) => void): SwarmLink<Connection> {
    const connection = new Connection(invitation);
    connection.listen(({ kind }) => kind === "moved" && onMoved?.(connection.pin));
    const link = new SwarmLink(connection);
    opened.push(link);
    return link;
  }

  const live = (link: SwarmLink<Connection>, robots = 3) =>
    vi.waitFor(() => {
      expect(link.view.health.state).toBe("live");
      expect(link.view.swarm.robots.size).toBe(robots);
    }, 8000);

  test.each([5, 4] as const)("MQTT protocol %i: robots, commands, requests", async (mqtt) => {
    const fake = swarm({ width: 3000 });
    const link = join(to(P1, mqtt));
    await live(link);
    await vi.waitFor(() => expect(link.view.swarm.area).toEqual({ width: 3000, height: 2000, unit: "mm" }));
    const address = fake.robots[0]?.address ?? "";
    expect(link.command(address, "rgb_led", { red: 9, green: 8, blue: 7 })).toBe(true);
    await vi.waitFor(() => expect(link.view.swarm.robots.get(address)?.led).toEqual({ red: 9, green: 8, blue: 7 }));
    expect(fake.told).toEqual([{ address, name: "rgb_led", payload: { red: 9, green: 8, blue: 7 } }]);
    expect(await link.request(1)).toEqual({ width: 3000, height: 2000 });
    await expect(link.request(42, {}, 200)).rejects.toBeInstanceOf(Unanswered);
    expect(fake.requests.filter(({ request }) => request === 0).every(({ frames }) => frames === true)).toBe(true);
  });

  test("follows a rotation at once, tells the new pin, and is answered under it", async () => {
    const fake = swarm();
    const pins: string[] = [];
    const link = join(to(), (pin) => pins.push(pin.reveal()));
    await live(link);
    fake.rotate(P2);
    await vi.waitFor(() => expect(pins).toEqual([P2]));
    expect(await link.request(1)).toEqual({ width: 2000, height: 2000 });
    const before = link.view.swarm.seq ?? 0;
    await vi.waitFor(() => expect(link.view.swarm.seq).toBeGreaterThan(before + 3));
    expect(link.view.health.state).toBe("live");
  });

  test("slept through a rotation: finds the swarm again by asking", async () => {
    const fake = swarm();
    const pins: string[] = [];
    const link = join(to(), (pin) => pins.push(pin.reveal()));
    await live(link);
    fake.rotate(P3, false);
    await vi.waitFor(() => expect(pins).toEqual([P3]), { timeout: 12_000, interval: 200 });
    await live(link);
  });

  test("a broker that goes and comes back is found again, with its topics", async () => {
    const own = await Broker.start();
    swarm({ broker: own.url });
    const link = join({ ...to(), broker: own.url });
    await live(link);
    await own.down();
    await vi.waitFor(() => expect(link.view.health.state).toBe("offline"), 5000);
    expect(link.command("A", "rgb_led", {})).toBe(false);
    await expect(link.request(0)).rejects.toBeInstanceOf(Unanswered);
    await own.up();
    await live(link);
    link.close();
    await own.stop();
  });

  test("no broker: offline; another pin: silent", async () => {
    swarm();
    const nowhere = join({ ...to(), broker: `ws://127.0.0.1:${await freePort()}/mqtt` });
    const stranger = join(to("999999999999"));
    await vi.waitFor(() => expect(nowhere.view.health.state).toBe("offline"), 3000);
    await vi.waitFor(() => expect(stranger.view.health.state).toBe("silent"), { timeout: 9000, interval: 200 });
    expect(stranger.view.swarm.robots.size).toBe(0);
  });

  test("woken, it asks at once; and when nothing comes, it makes another connection", async () => {
    const fake = swarm();
    const link = join();
    await live(link);
    const asked = fake.requests.length;
    await new Promise((resolve) => setTimeout(resolve, 1100));
    link.wake();
    await vi.waitFor(() => expect(fake.requests.length).toBeGreaterThan(asked));
    fake.mute = true;
    const states: string[] = [];
    link.transport.listen((event) => event.kind === "broker" && states.push(event.state));
    // What was said before has to be through.
    await new Promise((resolve) => setTimeout(resolve, 600));
    link.wake();
    await vi.waitFor(() => expect(states).toEqual(["offline", "online"]), 6000);
    fake.mute = false;
    await live(link);
  });

  test("a wrong clock is told, and forgotten when it is right again", async () => {
    const fake = swarm();
    const link = join();
    await live(link);
    fake.clock_s = 45;
    await vi.waitFor(() => expect(link.view.health).toEqual({ state: "clock", skew_s: 45 }), 5000);
    fake.clock_s = 0;
    await vi.waitFor(() => expect(link.view.health.state).toBe("live"), 3000);
    expect(link.transport.rejected.get("stale")).toBeGreaterThan(2);
  });

  test("a replayed notification is refused", async () => {
    const fake = swarm();
    const link = join();
    await live(link);
    const bytes = fake.say("notify", { cmd: 1 });
    await vi.waitFor(() => expect(link.view.swarm.missed).toBeGreaterThan(0));
    const { missed } = link.view.swarm;
    fake.repeat("notify", bytes);
    await vi.waitFor(() => expect(link.transport.rejected.get("replayed")).toBe(1));
    expect(link.view.swarm.missed).toBe(missed);
  });

  test("an older server: unit square, no frames, no request 1", async () => {
    const fake = swarm({ frames: false, robots: 4 });
    const link = join();
    await live(link, 4);
    expect(link.view.swarm.area).toEqual({ width: 1, height: 1, unit: "side" });
    const address = fake.robots[1]?.address ?? "";
    const before = link.view.swarm.robots.get(address)?.position;
    await vi.waitFor(() => expect(link.view.swarm.robots.get(address)?.position).not.toEqual(before));
    link.command(address, "waypoints", { threshold: 50, waypoints: [{ x: 0.5, y: 0.5, z: 0 }] });
    await vi.waitFor(() => expect(link.view.swarm.robots.get(address)?.waypoints).toHaveLength(2), 3000);
  });

  test("the command-line peer speaks JSON lines, and only those", async () => {
    const fake = swarm();
    interface Said {
      readonly event: string;
      readonly id?: number;
      readonly data?: unknown;
    }
    const said: Said[] = [];
    const url = `http://page/${qrFragment(to())}`;
    const peer: ChildProcess = spawn(process.execPath, ["--import", "tsx", "tests/peer.ts", url], {
      cwd: `${import.meta.dirname}/../..`,
      stdio: ["pipe", "pipe", "inherit"],
    });
    const ended = new Promise((resolve) => peer.on("exit", resolve));
    if (!peer.stdout || !peer.stdin) throw new Error("no pipes");
    createInterface({ input: peer.stdout }).on("line", (line) => said.push(JSON.parse(line) as Said));
    const heard = (event: string) =>
      vi.waitFor(() => expect(said.map((words) => words.event)).toContain(event), 10_000);
    const order = (words: object) => peer.stdin?.write(`${JSON.stringify(words)}\n`);
    await heard("ready");
    order({ do: "request", request: 1, id: 7 });
    order({ do: "command", address: "AB", application: "0", name: "move_raw", payload: { left_y: 1 } });
    order({ do: "dance" });
    await heard("reply");
    await heard("notify");
    await heard("error");
    expect(said.find(({ event }) => event === "reply")).toEqual({
      event: "reply",
      id: 7,
      data: { width: 2000, height: 2000 },
    });
    await vi.waitFor(() => expect(fake.told).toEqual([{ address: "AB", name: "move_raw", payload: { left_y: 1 } }]));
    fake.rotate(P2);
    await heard("moved");
    order({ do: "quit" });
    expect(await ended).toBe(0);
    expect(JSON.stringify(said)).not.toMatch(new RegExp(`${P1}|${P2}`));
  });
});
