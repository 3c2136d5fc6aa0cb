// Many visitors in one process: each the library of the pages with a connection of its own, and every message opened.
//
//   node --import ../web/node_modules/tsx/dist/loader.mjs --import ./native_jwe.mjs fleet_visitors.mts < order
//
// The order is one JSON line. Every further line on stdin is answered with the counters since the last one. What a page
// does with a frame, and draws, is not done here: one real page among the visitors does.

import { createInterface } from "node:readline";
import { setTimeout as sleep } from "node:timers/promises";
import { isObject, type Json, type JsonObject } from "../web/client/core/json";
import { parseQrUrl } from "../web/client/core/qrurl";
import { Connection, type ConnectionEvent } from "../web/client/io/connection";
import { readPlaces } from "../web/client/places";
import { REQUEST_AREA, REQUEST_ROBOTS } from "../web/client/swarm";
import { Watch } from "../web/client/watch";

interface Order {
  readonly qr: string;
  readonly visitors: number;
  readonly join_per_s: number;
  readonly routes_per_s: number;
}

const FRAME = 16;
const WATCH_MS = 250;
// 64 places at random keep a robot busy for about five minutes: each gets others before it has arrived.
const WAYPOINTS = 64;
const THRESHOLD_MM = 60;
const ROUTE_MS = 240_000;
const AREA_MM = 2000;
const EDGE_MM = 100;

/** What all visitors counted since they were asked last. */
class Tally {
  readonly #since_ms = performance.now();
  readonly #cpu = process.cpuUsage();
  messages = 0;
  frames = 0;
  gaps = 0;
  missed = 0;
  cut_off = 0;
  asked = 0;
  answered = 0;
  routes = 0;
  readonly rejected: Record<string, number> = {};
  /** Frames by their age when opened, whole milliseconds. */
  readonly ages_ms: Record<number, number> = {};

  /** With the time all that took, and how long a processor worked for it. */
  report(): object {
    const { user, system } = process.cpuUsage(this.#cpu);
    return { ...this, elapsed_s: (performance.now() - this.#since_ms) / 1000, cpu_s: (user + system) / 1e6 };
  }
}

class Visitor {
  readonly listed: Promise<void>;
  addresses: readonly string[] = [];
  tally: Tally;
  frames = 0;
  missed = 0;
  ticks = 0;
  worstAge_s = 0;
  readonly #connection: Connection;
  readonly #watch = new Watch(performance.now());
  #onListed: () => void = () => {};
  #seq: number | undefined;
  #lastRobot = -1;
  #sentAt_s = 0;

  constructor(qr: string, tally: Tally) {
    this.tally = tally;
    this.listed = new Promise((resolve) => (this.#onListed = resolve));
    this.#connection = new Connection(parseQrUrl(qr));
    this.#connection.listen((event) => this.#on(event));
  }

  /** Ask for the list of robots, or for the area, when a page would. */
  look(): void {
    const now_ms = performance.now();
    const list = this.#watch.due(now_ms, Math.random());
    if (!list && !this.#watch.presenceDue(now_ms)) return;
    if (list) this.tally.asked += 1;
    // The answer also comes as an event; that none came is seen by the watch.
    this.#connection.request(list ? REQUEST_ROBOTS : REQUEST_AREA, { frames: true }).catch(() => {});
  }

  /** Send a robot on a long tour. */
  sendRound(address: string): void {
    const within = () => Math.round(EDGE_MM + Math.random() * (AREA_MM - 2 * EDGE_MM));
    const waypoints = Array.from({ length: WAYPOINTS }, () => ({ x: within(), y: within(), z: 0 }));
    const sent = this.#connection.command(address, "0", "waypoints", { threshold: THRESHOLD_MM, waypoints });
    if (sent) this.tally.routes += 1;
  }

  /** This visitor's share since it was asked last: frames, missed ones, the oldest's age, ticks. */
  share(tally: Tally): readonly number[] {
    // What is still on its way counts as late, too.
    const worst_s = Math.max(this.worstAge_s, Date.now() / 1000 - this.#sentAt_s);
    const share = [this.frames, this.missed, worst_s, this.ticks];
    this.frames = this.missed = this.ticks = this.worstAge_s = 0;
    this.tally = tally;
    return share;
  }

  // As web/client/io/swarm_link.ts, but that no swarm is kept.
  #on(event: ConnectionEvent): void {
    const now_ms = performance.now();
    if (event.kind === "broker") {
      this.#watch.broker(event.state, now_ms, Math.random());
      if (event.state === "offline") this.tally.cut_off += 1;
      return;
    }
    this.tally.messages += 1;
    if (event.kind === "rejected") {
      if (event.skew_s !== undefined) this.#watch.stale(event.skew_s, now_ms);
      this.tally.rejected[event.reason] = (this.tally.rejected[event.reason] ?? 0) + 1;
      return;
    }
    this.#watch.heard(now_ms);
    if (event.kind === "moved") this.#watch.missed(now_ms, Math.random());
    if (event.kind === "part") this.#watch.answering(now_ms);
    if (event.kind === "replied" && event.request === REQUEST_ROBOTS) this.#onList(event.data);
    if (event.kind === "notified" && isObject(event.payload) && event.payload["cmd"] === FRAME) {
      this.#onFrame(event.payload["data"] as JsonObject, event.timestamp_s);
    }
  }

  #onList(robots: Json): void {
    this.#watch.answered();
    this.tally.answered += 1;
    this.addresses = (robots as { address: string }[]).map(({ address }) => address);
    this.#onListed();
  }

  #onFrame(frame: JsonObject, sentAt_s: number): void {
    const { tally } = this;
    const age_s = Date.now() / 1000 - sentAt_s;
    const age_ms = Math.round(age_s * 1000);
    tally.ages_ms[age_ms] = (tally.ages_ms[age_ms] ?? 0) + 1;
    tally.frames += 1;
    this.frames += 1;
    this.worstAge_s = Math.max(this.worstAge_s, age_s);
    this.#sentAt_s = sentAt_s;

    const seq = frame["seq"] as number;
    if (this.#seq !== undefined && seq !== this.#seq + 1) {
      const missed = Math.max(0, seq - this.#seq - 1);
      tally.gaps += 1;
      tally.missed += missed;
      this.missed += missed;
      this.#watch.missed(performance.now(), Math.random());
    }
    this.#seq = seq;
    this.#watch.framed();

    // Within a tick the frames name robots in the order of their numbers, so a lower one is the next tick's. Times of
    // sending would not tell: a busy machine holds up a tick's own frames, and one late tick comes close to the next.
    const places = readPlaces(frame["places"]);
    const [first, last] = [places[0]?.number, places.at(-1)?.number];
    if (first === undefined || last === undefined) return;
    if (first <= this.#lastRobot) this.ticks += 1;
    this.#lastRobot = last;
  }
}

/** Every robot gets a route, and another before it has arrived; the visitors take turns. */
async function sendRound(visitors: readonly Visitor[], perSecond: number): Promise<void> {
  const addresses = visitors[0]?.addresses ?? [];
  let pause_ms = 1000 / perSecond;
  for (;;) {
    for (const [i, address] of addresses.entries()) {
      visitors[i % visitors.length]?.sendRound(address);
      await sleep(pause_ms);
    }
    pause_ms = ROUTE_MS / addresses.length;
  }
}

async function main(): Promise<void> {
  const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
  const order = JSON.parse((await lines.next()).value as string) as Order;
  let tally = new Tally();
  const visitors: Visitor[] = [];
  setInterval(() => visitors.forEach((visitor) => visitor.look()), WATCH_MS);
  while (visitors.length < order.visitors) {
    visitors.push(new Visitor(order.qr, tally));
    await sleep(1000 / order.join_per_s);
  }
  await Promise.all(visitors.map(({ listed }) => listed));
  say({ joined: visitors.length });
  for (;;) {
    const { value: line, done } = await lines.next();
    if (done === true) process.exit();
    if (line === "go") void sendRound(visitors, order.routes_per_s);
    const next = new Tally();
    say({ each: visitors.map((visitor) => visitor.share(next)), ...tally.report() });
    tally = next;
  }
}

function say(words: object): void {
  process.stdout.write(`${JSON.stringify(words)}\n`);
}

await main();
