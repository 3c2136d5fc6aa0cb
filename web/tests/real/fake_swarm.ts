// A small swarm that speaks the server's side of the link, for tests of the client. Not a gateway: it checks little.

import { randomBytes } from "node:crypto";
import mqtt, { type MqttClient } from "mqtt";
import {
  deriveEpoch,
  type Epoch,
  type Json,
  type JsonObject,
  type Opened,
  open,
  Pin,
  ReplayCache,
  SERVER_MAX_BYTES,
  seal,
  sealJwe,
  splitTopic,
} from "../../client";
import { encodeBase64url } from "../../client/core/base64url";

export interface Told {
  readonly address: string;
  readonly name: string;
  readonly payload: unknown;
}

interface Options {
  readonly broker: string;
  readonly pin: string;
  readonly root?: string;
  readonly robots?: number;
  /** false: an older server with notification 2, without frames and request 1, on a unit square. */
  readonly frames?: boolean;
  readonly width?: number;
  readonly height?: number;
  readonly every_ms?: number;
}

const COLOURS = [
  [255, 45, 45],
  [255, 138, 0],
  [255, 225, 0],
  [24, 216, 96],
  [20, 210, 230],
  [47, 107, 255],
  [176, 75, 255],
  [255, 255, 255],
  [0, 0, 0],
] as const;
const NAMES = ["Ada", "Bo", "Cleo", "Dot", "Edi", "Fay", "Gus", "Hedy", "Ivo", "Joy", "Kit", "Lou"];

export class FakeSwarm {
  /** Commands that arrived. */
  readonly told: Told[] = [];
  readonly requests: JsonObject[] = [];
  /** Added to the clock by which messages are stamped. */
  clock_s = 0;
  /** While true nothing is answered or notified. */
  mute = false;
  readonly robots: Bot[];
  #epoch: Epoch;
  #last: Epoch | undefined;
  readonly #root: string;
  readonly #options: Options;
  readonly #cache = new ReplayCache(100_000, 30);
  readonly #mqtt: MqttClient;
  readonly #ticking: ReturnType<typeof setInterval>;
  #seq = 0;
  #turn = 0;
  readonly #changed: JsonObject[] = [];
  readonly #routes: Json[] = [];

  constructor(options: Options) {
    this.#options = options;
    this.#root = options.root ?? "/qrkey";
    this.#epoch = deriveEpoch(new Pin(options.pin));
    const unit = options.frames === false;
    const [width, height] = unit ? [1, 1] : [options.width ?? 2000, options.height ?? 2000];
    this.robots = Array.from({ length: options.robots ?? 3 }, (_, i) => new Bot(i, width, height, unit));
    this.#mqtt = mqtt.connect(options.broker, { protocolVersion: 5, resubscribe: false, reconnectPeriod: 300 });
    this.#mqtt.on("error", () => {});
    this.#mqtt.on("connect", () => this.#subscribe(this.#epoch));
    this.#mqtt.on("message", (topic, bytes) => this.#read(topic, bytes));
    this.#ticking = setInterval(() => this.#tick(), options.every_ms ?? 100);
  }

  get pin(): Pin {
    return this.#epoch.pin;
  }

  stop(): void {
    clearInterval(this.#ticking);
    this.#mqtt.end(true);
  }

  /** Move to another pin. `tell` false: nobody hears of it, as if every phone slept. */
  rotate(pin: string, tell = true): void {
    const old = this.#epoch;
    this.#last = old;
    this.#epoch = deriveEpoch(new Pin(pin));
    this.#subscribe(this.#epoch);
    if (tell) this.#sendPin(old);
  }

  /** A message on a topic of the current epoch, whatever it says. */
  say(sub: string, payload: unknown, at_s = Date.now() / 1000 + this.clock_s): Uint8Array {
    const bytes = seal(payload, at_s, this.#epoch, randomBytes(12));
    this.repeat(sub, bytes);
    return bytes;
  }

  repeat(sub: string, bytes: Uint8Array): void {
    this.#mqtt.publish(`${this.#root}/${this.#epoch.topic}/${sub}`, Buffer.from(bytes));
  }

  #sendPin(epoch: Epoch): void {
    const words = JSON.stringify({ cmd: 255, pin_code: this.#epoch.pin.reveal() });
    const bytes = sealJwe(new TextEncoder().encode(words), epoch.key, randomBytes(12));
    this.#mqtt.publish(`${this.#root}/${epoch.topic}/notify`, Buffer.from(bytes));
  }

  #subscribe(epoch: Epoch): void {
    const base = `${this.#root}/${epoch.topic}`;
    this.#mqtt.subscribe([`${base}/command/#`, `${base}/request`]);
  }

  #read(topic: string, bytes: Uint8Array): void {
    const old = this.#last && topic.startsWith(`${this.#root}/${this.#last.topic}/`) ? this.#last : undefined;
    const epoch = old ?? this.#epoch;
    const sub = splitTopic(this.#root, epoch.topic, topic);
    const now_s = Date.now() / 1000 + this.clock_s;
    let opened: Opened;
    try {
      opened = open(bytes, epoch, now_s, this.#cache, SERVER_MAX_BYTES, false);
    } catch {
      return;
    }
    if (opened.kind !== "envelope" || this.mute) return;
    if (old) {
      if (sub.kind === "request") this.#sendPin(old);
      return;
    }
    if (sub.kind === "request") this.#answer(opened.payload as JsonObject);
    if (sub.kind === "command") this.#obey(sub.address, sub.name, opened.payload as JsonObject);
  }

  #answer(words: JsonObject): void {
    this.requests.push(words);
    const { request } = words;
    const reply = words["reply"] as string;
    const { width = 2000, height = 2000 } = this.#options;
    if (request === 0) this.say(`reply/${reply}`, { request, data: this.robots.map((bot) => bot.words()) });
    if (request === 1 && this.#options.frames !== false)
      this.say(`reply/${reply}`, { request, data: { width, height } });
  }

  #obey(address: string, name: string, payload: JsonObject): void {
    this.told.push({ address, name, payload });
    const bot = this.robots.find((robot) => robot.address === address);
    if (!bot) return;
    const change = bot.obey(name, payload);
    if (this.#options.frames === false) this.say("notify", { cmd: 1 });
    else if (change) this.#changed.push({ address, ...change });
    if (name === "waypoints") this.#routes.push(bot.route());
  }

  #tick(): void {
    for (const bot of this.robots) bot.step((this.#options.every_ms ?? 100) / 1000);
    if (this.mute || !this.#mqtt.connected || this.robots.length === 0) return;
    if (this.#options.frames === false) {
      this.#turn = (this.#turn + 1) % this.robots.length;
      const bot = this.robots[this.#turn];
      if (bot) this.say("notify", { cmd: 2, data: bot.update() });
      return;
    }
    this.#seq += 1;
    const [changed, routes] = [this.#changed.splice(0), this.#routes.splice(0)];
    const robots = this.robots.map((bot) => bot.row());
    this.say("notify", { cmd: 16, data: { seq: this.#seq, robots, changed, routes } });
  }
}

/** Wanders about until it is driven. */
class Bot {
  readonly address: string;
  readonly #number: number;
  readonly #name: string;
  readonly #width: number;
  readonly #height: number;
  readonly #unit: boolean;
  #x: number;
  #y: number;
  #direction: number;
  #led: JsonObject;
  #left = 0;
  #right = 0;
  #driven = false;
  #waypoints: JsonObject[] = [];
  #threshold = 40;
  #history: JsonObject[] = [];

  constructor(i: number, width: number, height: number, unit: boolean) {
    this.address = (0xdecafbad00000000n + BigInt(i * 2654435761)).toString(16).toUpperCase().padStart(16, "0");
    this.#number = i;
    this.#name = `${NAMES[i % NAMES.length]}${i < NAMES.length ? "" : ` ${Math.floor(i / NAMES.length) + 1}`}`;
    [this.#width, this.#height, this.#unit] = [width, height, unit];
    // A golden spiral: spread out, and the same every time.
    const [angle, reach] = [i * 2.399963, Math.sqrt((i + 0.5) / Math.max(i + 1, 12)) * 0.42];
    this.#x = width * (0.5 + reach * Math.cos(angle));
    this.#y = height * (0.5 + reach * Math.sin(angle));
    this.#direction = (i * 67) % 360;
    const [red, green, blue] = COLOURS[i % COLOURS.length] ?? [0, 0, 0];
    this.#led = { red, green, blue };
  }

  step(dt_s: number): void {
    const [left, right] = this.#driven ? [this.#left, this.#right] : [18, 24];
    const mm = this.#unit ? 1 / 2000 : 1;
    this.#direction = (this.#direction + (left - right) * dt_s * 2 + 360) % 360;
    const angle = (this.#direction * Math.PI) / 180;
    const speed = (left + right) * 1.2 * dt_s * mm;
    this.#x = Math.min(Math.max(this.#x - Math.sin(angle) * speed, 0), this.#width);
    this.#y = Math.min(Math.max(this.#y + Math.cos(angle) * speed, 0), this.#height);
    this.#history = [...this.#history, { x: this.#x, y: this.#y, z: 0 }].slice(-50);
  }

  obey(name: string, payload: JsonObject): JsonObject | undefined {
    if (name === "move_raw") {
      this.#driven = true;
      [this.#left, this.#right] = [Number(payload["left_y"]), Number(payload["right_y"])];
      return undefined;
    }
    if (name === "rgb_led") {
      this.#led = payload;
      return { rgb_led: payload };
    }
    if (name === "waypoints") {
      const points = payload["waypoints"] as JsonObject[];
      this.#waypoints = points.length > 0 ? [{ x: this.#x, y: this.#y, z: 0 }, ...points] : [];
      this.#threshold = Number(payload["threshold"]);
      return { waypoints_threshold: this.#threshold };
    }
    this.#history = [];
    return { history_cleared: true };
  }

  route(): Json {
    const points = this.#waypoints.flatMap(({ x, y }) => [Math.round(Number(x)), Math.round(Number(y))]);
    return [this.#number, 0, 0, 1, encodeBase64url(new Uint8Array(Uint16Array.from(points).buffer))];
  }

  words(): JsonObject {
    return {
      address: this.address,
      ...(!this.#unit && { n: this.#number }),
      ...(!this.#unit && { name: this.#name }),
      application: 0,
      swarm: "0000",
      status: 0,
      mode: 0,
      last_seen: 0,
      direction: Math.round(this.#direction),
      lh2_position: { x: this.#x, y: this.#y, z: 0 },
      rgb_led: this.#led,
      waypoints: this.#waypoints,
      waypoints_threshold: this.#threshold,
      position_history: this.#history,
      calibrated: 1,
      battery: 2.9,
    };
  }

  update(): JsonObject {
    const { address, direction, lh2_position, battery } = this.words();
    return { address, direction, lh2_position, battery };
  }

  row(): number[] {
    return [this.#number, Math.round(this.#x), Math.round(this.#y), Math.round(this.#direction)];
  }
}
