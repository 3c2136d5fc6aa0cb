// A real mosquitto on a free port of this machine, for as long as a test lasts.

import { type ChildProcess, spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";

const MOSQUITTO = ["/usr/sbin/mosquitto", "/usr/local/sbin/mosquitto", "/opt/homebrew/sbin/mosquitto"].find(existsSync);

export const haveBroker = MOSQUITTO !== undefined;

/** A free one of a range that neither other tests, nor gateways, nor outgoing connections draw from. */
export async function freePort(): Promise<number> {
  const port = 18_000 + Math.floor(Math.random() * 2_000);
  const isFree = await new Promise<boolean>((resolve) => {
    const server = createServer();
    server.on("error", () => resolve(false));
    server.listen(port, "127.0.0.1", () => server.close(() => resolve(true)));
  });
  return isFree ? port : freePort();
}

export class Broker {
  readonly port: number;
  readonly tcpPort: number;
  readonly #folder = mkdtempSync(join(tmpdir(), "phalanx-broker-"));
  #child: ChildProcess | undefined;

  private constructor(port: number, tcpPort: number) {
    this.port = port;
    this.tcpPort = tcpPort;
  }

  static async start(): Promise<Broker> {
    const broker = new Broker(await freePort(), await freePort());
    await broker.up();
    return broker;
  }

  get url(): string {
    return `ws://127.0.0.1:${this.port}/mqtt`;
  }

  /** Start it (again), on the same port. */
  async up(): Promise<void> {
    if (!MOSQUITTO) throw new Error("no mosquitto on this machine");
    const config = join(this.#folder, "mosquitto.conf");
    // mosquitto 2.0.11 counts no websocket listener as one, and ends if there is no other.
    const listeners = [`listener ${this.tcpPort} 127.0.0.1`, `listener ${this.port} 127.0.0.1`, "protocol websockets"];
    writeFileSync(config, [...listeners, "allow_anonymous true", "persistence false", ""].join("\n"));
    const child = spawn(MOSQUITTO, ["-c", config], { stdio: ["ignore", "ignore", "pipe"] });
    this.#child = child;
    // A test run that breaks off must not leave a broker behind.
    process.once("exit", () => child.kill("SIGKILL"));
    await new Promise<void>((resolve, reject) => {
      child.on("exit", (code) => reject(new Error(`mosquitto ended with ${code}`)));
      child.stderr.on("data", (text) => {
        if (String(text).includes("running")) resolve();
      });
    });
  }

  async down(): Promise<void> {
    const child = this.#child;
    this.#child = undefined;
    if (!child) return;
    await new Promise((resolve) => {
      child.removeAllListeners("exit");
      child.on("exit", resolve);
      child.kill("SIGKILL");
    });
  }

  async stop(): Promise<void> {
    await this.down();
    rmSync(this.#folder, { recursive: true, force: true });
  }
}
