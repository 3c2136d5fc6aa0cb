// Imports point one way: pages -> map -> react -> io -> the swarm's words -> core; and what is pure stays pure.

import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, normalize, relative } from "node:path";
import { describe, expect, test } from "vitest";

const WEB = join(import.meta.dirname, "..");

/** Who may import whom: a file may use its own layer and those before it. */
const LAYERS = ["client/core", "client/session", "client", "client/io", "client/react", "client/index", "texts", "map", "visitor"];
const PACKAGES: Readonly<Record<string, readonly string[]>> = {
  "client/core": [],
  "client/session": ["@noble/ciphers", "@noble/curves", "@noble/hashes"],
  client: [],
  "client/io": ["@noble/hashes", "mqtt"],
  "client/react": ["react"],
  "client/index": [],
  texts: ["react"],
  map: ["react"],
  visitor: ["react", "react-dom"],
};
const PURE = ["client/core", "client/session", "client"];
// Clock, random, network, storage, page.
const IMPURE =
  /\b(Date\.now|new Date|Math\.random|performance\.|setTimeout|setInterval|getRandomValues|randomBytes|fetch\(|new WebSocket|localStorage|sessionStorage|document\.|window\.|console\.)/;

const files = ["client", "texts", "map", "visitor"].flatMap((folder) =>
  readdirSync(join(WEB, folder), { recursive: true, encoding: "utf8" })
    .filter((name) => /\.tsx?$/.test(name))
    .map((name) => join(folder, name)),
);

function layerOf(path: string): string {
  if (path.startsWith("client/index")) return "client/index";
  const folder = LAYERS.filter((layer) => path.startsWith(`${layer}/`)).sort((a, b) => b.length - a.length)[0];
  if (folder === undefined) throw new Error(`${path} is on no layer`);
  return folder;
}

function importsOf(path: string): string[] {
  const source = readFileSync(join(WEB, path), "utf8");
  return [...source.matchAll(/^(?:import|export)\b[^;]*?from "([^"]+)";|^import "([^"]+)";/gm)].map(
    (found) => found[1] ?? found[2] ?? "",
  );
}

describe("imports", () => {
  test("there is something to check", () => {
    expect(files.length).toBeGreaterThan(30);
    expect(files.flatMap(importsOf).length).toBeGreaterThan(60);
  });

  test.each(files)("%s", (path) => {
    const layer = layerOf(path);
    for (const name of importsOf(path)) {
      if (name.startsWith(".")) {
        let target = relative(WEB, normalize(join(WEB, dirname(path), name)));
        if (target === "client" || target === "texts") target += "/index";
        expect(LAYERS.indexOf(layerOf(target)), `${path} imports ${target}`).toBeLessThanOrEqual(LAYERS.indexOf(layer));
      } else {
        const owner = name
          .split("/")
          .slice(0, name.startsWith("@") ? 2 : 1)
          .join("/");
        expect(PACKAGES[layer], `${path} imports ${name}`).toContain(owner);
      }
    }
    if (PURE.includes(layer)) expect(readFileSync(join(WEB, path), "utf8")).not.toMatch(IMPURE);
  });
});
