// What a phone loads before it shows the swarm: few bytes, and a picture before any of them but the page itself.

import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { afterAll, beforeAll, expect, test } from "vitest";

const WEB = join(import.meta.dirname, "..");
/** Gzipped, of all that is loaded at first. */
const BUDGET_BYTES = 70_000;

const folder = mkdtempSync(join(tmpdir(), "phalanx-budget-"));
let html: string;

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

beforeAll(() => {
  execFileSync(join(WEB, "node_modules/.bin/vite"), ["build", "--outDir", folder, "--logLevel", "error"], {
    cwd: WEB,
    env: { ...process.env, NODE_ENV: "production", PAGE: "visitor" },
  });
  html = readFileSync(join(folder, "index.html"), "utf8");
});

afterAll(() => rmSync(folder, { recursive: true, force: true }));

test("the visitor's page is small, and has no MQTT client in what it loads at first", () => {
  const assets = [...html.matchAll(/(?:src|href)="\.\/(assets\/[^"]+\.(?:js|css))"/g)].map(([, name]) => name ?? "");
  const loaded = new Set(assets.flatMap((name) => [...withImports(name)]));
  expect([...loaded].filter((name) => name.endsWith(".js")).length).toBeGreaterThan(0);
  expect([...loaded].filter((name) => name.endsWith(".css")).length).toBeGreaterThan(0);
  const all = ["index.html", ...loaded].map((name) => readFileSync(join(folder, name)));
  const bytes = all.reduce((sum, each) => sum + gzipSync(each, { level: 9 }).length, 0);
  expect(bytes).toBeLessThanOrEqual(BUDGET_BYTES);
  expect(all.some((each) => each.includes("mqttv"))).toBe(false);
});

test("the picture stands before the stylesheet, which nothing else waits for", () => {
  expect(html.indexOf("<svg")).toBeGreaterThan(0);
  expect(html.indexOf("<svg")).toBeLessThan(html.indexOf('rel="stylesheet"'));
  expect(html.slice(0, html.indexOf("<svg"))).not.toContain("<style");
});
