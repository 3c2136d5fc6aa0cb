// The shared vectors of state updates: the same cases decide what Python packs and this client reads.

import { readFileSync } from "node:fs";
import { describe, expect, test } from "vitest";
import type { Json } from "../client";
import { readPlaces, readRoute } from "../client/places";

interface Case {
  readonly name: string;
}

// The type says what the file's cases hold; the file is ours.
// eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters
function load<C extends Case>(file: string): readonly C[] {
  const text = readFileSync(`${import.meta.dirname}/../../vectors/${file}.json`, "utf8");
  const { cases } = JSON.parse(text) as { cases: readonly C[] };
  expect(cases.length).toBeGreaterThan(0);
  return cases;
}

describe("places", () => {
  test.each(load<Case & { places: Json; read: number[][] }>("places"))("$name", (c) => {
    expect(readPlaces(c.places).map(({ number, x, y, direction }) => [number, x, y, direction])).toEqual(c.read);
  });
});

describe("routes", () => {
  test.each(load<Case & { route: Json; read: number[][] | null }>("routes"))("$name", (c) => {
    expect(readRoute(c.route)?.points.map(({ x, y }) => [x, y]) ?? null).toEqual(c.read);
  });
});
