// What a phone loads before it shows the swarm: few bytes, and a picture before any of them but the page itself.

import { execFileSync } from "node:child_process";
import { mkdtempSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { afterAll, beforeAll, expect, test } from "vitest";

const WEB = join(import.meta.dirname, "..");
/** Gzipped, of all that is loaded at first. */
const BUDGET_BYTES = 70_000;
/** German texts come beside the English ones, which are in the page's own script. */
const GERMAN_BYTES = 72_000;

const folder = mkdtempSync(join(tmpdir(), "phalanx-budget-"));
let html: string;
/** All that a phone loads at first beside the page itself. */
let loaded: ReadonlySet<string>;

/** What this file needs at once: `import x from "./y.js"`, and not `import("./y.js")`. */
function withImports(name: string, known = new Set<string>()): Set<string> {
  if (known.has(name)) return known;
  known.add(name);
  const source = name.endsWith(".js") ? readFileSync(join(folder, name), "utf8") : "";
  for (const [, , found] of source.matchAll(/(^|[;}])import[^()"']*["']\.\/([^"']+\.js)["']/g)) {
    if (found !== undefined) withImports(join("assets", found), known);
  }
  return known;
}

function bytesOf(names: readonly string[]): number {
  return names.reduce((sum, name) => sum + gzipSync(readFileSync(join(folder, name)), { level: 9 }).length, 0);
}

beforeAll(() => {
  execFileSync(join(WEB, "node_modules/.bin/vite"), ["build", "--outDir", folder, "--logLevel", "error"], {
    cwd: WEB,
    env: { ...process.env, NODE_ENV: "production", PAGE: "visitor" },
  });
  html = readFileSync(join(folder, "index.html"), "utf8");
  const assets = [...html.matchAll(/(?:src|href)="\.\/(assets\/[^"]+\.(?:js|css))"/g)].map(([, name]) => name ?? "");
  loaded = new Set(assets.flatMap((name) => [...withImports(name)]));
});

afterAll(() => rmSync(folder, { recursive: true, force: true }));

test("the visitor's page is small, and has no MQTT client in what it loads at first", () => {
  expect([...loaded].filter((name) => name.endsWith(".js")).length).toBeGreaterThan(0);
  expect([...loaded].filter((name) => name.endsWith(".css")).length).toBeGreaterThan(0);
  expect(bytesOf(["index.html", ...loaded])).toBeLessThanOrEqual(BUDGET_BYTES);
  expect([...loaded].some((name) => readFileSync(join(folder, name)).includes("mqttv"))).toBe(false);
});

test("German is loaded by those who read it, and is small as well", () => {
  const scripts = readdirSync(join(folder, "assets")).filter((name) => name.endsWith(".js"));
  const german = scripts.filter((name) => readFileSync(join(folder, "assets", name), "utf8").includes("Steuere den Schwarm"));
  expect(german).toHaveLength(1);
  expect(loaded).not.toContain(join("assets", german[0] ?? ""));
  expect(bytesOf(["index.html", ...loaded, ...german.map((name) => join("assets", name))])).toBeLessThanOrEqual(GERMAN_BYTES);
  const all = scripts.map((name) => readFileSync(join(folder, "assets", name), "utf8")).join("");
  expect(all, "texts of the operator's page").not.toMatch(/Stop all robots|Alle Roboter stoppen/);
});

test("the picture stands before the stylesheet, which nothing else waits for", () => {
  expect(html.indexOf("<svg")).toBeGreaterThan(0);
  expect(html.indexOf("<svg")).toBeLessThan(html.indexOf('rel="stylesheet"'));
  expect(html.slice(0, html.indexOf("<svg"))).not.toContain("<style");
});
