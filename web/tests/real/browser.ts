// A real chromium, without a profile. Its name for this machine, swarm.test, makes an insecure origin of every page, as a
// LAN address does: 127.0.0.1 would count as secure.

import { existsSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { type BrowserContext, chromium, type Page } from "playwright-core";

// The first has the same engine and no windows: a page takes half of the processor time.
const NAMES = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"];
const CHROMIUM = NAMES.map((name) => join("/usr/bin", name)).find(existsSync);

export const haveBrowser = CHROMIUM !== undefined;
export const HOST = "swarm.test";

export class Browser {
  /** What pages complained of: errors, refused by policy, failed to load. */
  readonly complaints: string[] = [];
  readonly #context: BrowserContext;
  readonly #folder: string;

  private constructor(context: BrowserContext, folder: string) {
    this.#context = context;
    this.#folder = folder;
  }

  static async start(): Promise<Browser> {
    if (!CHROMIUM) throw new Error("no chromium on this machine");
    const folder = mkdtempSync(join(tmpdir(), "phalanx-chromium-"));
    const context = await chromium.launchPersistentContext(folder, {
      executablePath: CHROMIUM,
      headless: true,
      hasTouch: true,
      reducedMotion: "reduce", // half of what it computes
      viewport: { width: 390, height: 844 },
      args: [
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        `--host-resolver-rules=MAP ${HOST} 127.0.0.1`,
      ],
    });
    return new Browser(context, folder);
  }

  async open(url: string): Promise<Page> {
    const page = await this.#context.newPage();
    page.on("console", (message) => {
      if (message.type() === "error" || message.type() === "warning") this.complaints.push(message.text());
    });
    page.on("pageerror", (error) => this.complaints.push(error.message));
    await page.goto(url);
    return page;
  }

  async stop(): Promise<void> {
    await this.#context.close();
    rmSync(this.#folder, { recursive: true, force: true });
  }
}
