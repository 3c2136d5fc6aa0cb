// The editor's requests to the gateway, with validated answers: load a building, parse a mission from YAML, compile and
// audit a mission, start it on robots.

import { UsageError } from "../../client";
import { operator as texts } from "../../texts";
import type { Station } from "../station";
import type { Draft, Place, Site, Words } from "./draft";

export interface World {
  readonly name: string;
  /** x0, y0, x1, y1: metres. */
  readonly bounds: readonly [number, number, number, number];
  readonly start: Place | undefined;
  readonly walls: readonly (readonly [number, number, number, number])[];
  readonly sites: readonly Site[];
}

/** What a captured file is worth, node by node. */
export interface WorthRow {
  readonly name: string;
  readonly candidates: number;
  readonly core_s: number;
  readonly gpu_s: number;
  readonly robot_ms: number;
  /** Tries of an attacker with the floor plan; null: as many as without it. */
  readonly by_plan: number | null;
  readonly problems: readonly string[];
  /** Why no robot is expected to decode it. */
  readonly infeasible: readonly string[];
  readonly out_of_reach: boolean;
}

export interface Compiled {
  readonly id: string;
  readonly nodes: number;
  readonly bytes: number;
  readonly profile: string;
  readonly rows: readonly WorthRow[];
  /** Costs of all readable nodes, on a core and on a GPU: at most, nearest first, with the floor plan. Null: none. */
  readonly costs: Readonly<Record<"most" | "nearest" | "plan", readonly [number | null, number | null]>>;
  readonly notes: readonly string[];
  /** Nodes whose landmark is not in the building. */
  readonly unseen: readonly string[];
  /** Assumed tries per second. */
  readonly rates: Readonly<Record<"hash_core" | "hash_gpu" | "kdf_core" | "kdf_gpu", number>>;
}

export type Job =
  | { readonly state: "none" }
  | { readonly state: "compiling"; readonly done: number; readonly of: number }
  | { readonly state: "failed"; readonly trouble: Trouble }
  | { readonly state: "compiled"; readonly compiled: Compiled };

/** An error of the gateway, with its hint. */
export class Trouble extends Error {
  readonly hint: string;

  constructor(message: string, hint = "") {
    super(message);
    this.hint = hint;
  }
}

const ANSWER_WITHIN_MS = 20_000;

/** Requests of the editor. All of them: @throws Trouble. */
export class Desk {
  readonly #station: Station;

  constructor(station: Station) {
    this.#station = station;
  }

  async world(): Promise<World> {
    return checked(readWorld, await this.#ask("world"));
  }

  /** The running mission; undefined: none, or one whose plain form is unknown. */
  async running(): Promise<Draft | undefined> {
    const said = await this.#ask("running");
    return isRecord(said) && said["nodes"] === undefined ? undefined : checked(readDraft, said);
  }

  async read(yaml: string): Promise<Draft> {
    return checked(readDraft, await this.#ask("read", { mission: yaml }));
  }

  async compile(yaml: string, profile: string): Promise<void> {
    await this.#ask("compile", { mission: yaml, profile });
  }

  async job(): Promise<Job> {
    return checked(readJob, await this.#ask("job"));
  }

  async send(id: string): Promise<void> {
    await this.#ask("send", { id });
  }

  async #ask(what: string, words: object = {}): Promise<unknown> {
    let said: unknown;
    try {
      said = await this.#station.ask(`mission_${what}`, words, ANSWER_WITHIN_MS);
    } catch (error) {
      if (error instanceof UsageError) throw new Trouble(texts.missionTooLong, texts.buildTakesIt);
      throw new Trouble(texts.doesNotAnswer);
    }
    // A failed job reports its own error.
    if (isRecord(said) && typeof said["error"] === "string" && said["state"] === undefined)
      throw new Trouble(said["error"], typeof said["hint"] === "string" ? said["hint"] : "");
    return said;
  }
}

function checked<T>(read: (json: unknown) => T, json: unknown): T {
  try {
    return read(json);
  } catch {
    throw new Trouble(texts.otherVersions, texts.reloadThisPage);
  }
}

// --- readers: each throws if something is missing ---------------------------------------------------------------------

export function readWorld(json: unknown): World {
  const it = record(json);
  return {
    name: text(it["name"]),
    bounds: four(it["bounds"]),
    start: it["start"] === null ? undefined : place(it["start"]),
    walls: list(it["walls"]).map(four),
    sites: list(it["sites"]).map((each) => {
      const site = record(each);
      return {
        type: text(site["type"]),
        at: place(site["at"]),
        see: site["see"],
        width: site["width"] === null ? undefined : finite(site["width"]),
      };
    }),
  };
}

export function readDraft(json: unknown): Draft {
  const it = record(json);
  return {
    name: text(it["name"]),
    rest: record(it["rest"]),
    nodes: list(it["nodes"]).map((each) => {
      const node = record(each);
      const { start, final, ...words } = record(node["words"]);
      return {
        name: text(node["name"]),
        start: start === true,
        final: final === true,
        words,
        at: node["at"] === null ? undefined : place(node["at"]),
        type: text(node["type"]),
      };
    }),
    ways: list(it["ways"]).map((each) => {
      const way = record(each);
      return { from: text(way["from"]), to: text(way["to"]), both: way["both"] === true, rest: record(way["rest"]) };
    }),
  };
}

export function readJob(json: unknown): Job {
  const it = record(json);
  switch (it["state"]) {
    case "none":
      return { state: "none" };
    case "compiling":
      return { state: "compiling", done: finite(it["done"]), of: finite(it["of"]) };
    case "failed":
      return { state: "failed", trouble: new Trouble(text(it["error"]), text(it["hint"])) };
    case "compiled":
      return { state: "compiled", compiled: readCompiled(it) };
    default:
      throw new TypeError("state");
  }
}

function readCompiled(it: Words): Compiled {
  const audit = record(it["audit"]);
  const rates = record(it["rates"]);
  return {
    id: text(it["id"]),
    nodes: finite(it["nodes"]),
    bytes: finite(it["bytes"]),
    profile: text(it["profile"]),
    costs: {
      most: [finiteOrNull(audit["core_s"]), finiteOrNull(audit["gpu_s"])],
      nearest: [finiteOrNull(audit["nearest_core_s"]), finiteOrNull(audit["nearest_gpu_s"])],
      plan: [finiteOrNull(audit["plan_core_s"]), finiteOrNull(audit["plan_gpu_s"])],
    },
    notes: list(audit["problems"]).map(text),
    unseen: list(it["unseen"]).map(text),
    rates: {
      hash_core: finite(rates["hash_core"]),
      hash_gpu: finite(rates["hash_gpu"]),
      kdf_core: finite(rates["kdf_core"]),
      kdf_gpu: finite(rates["kdf_gpu"]),
    },
    rows: list(audit["nodes"]).map((each) => {
      const row = record(each);
      return {
        name: text(row["name"]),
        candidates: finite(row["candidates"]),
        core_s: finite(row["core_s"]),
        gpu_s: finite(row["gpu_s"]),
        robot_ms: finite(row["robot_ms"]),
        by_plan: finiteOrNull(row["by_plan"]),
        problems: list(row["problems"]).map(text),
        infeasible: list(row["infeasible"]).map(text),
        out_of_reach: row["out_of_reach"] === true,
      };
    }),
  };
}

function isRecord(json: unknown): json is Words {
  return typeof json === "object" && json !== null && !Array.isArray(json);
}

function record(json: unknown): Words {
  if (!isRecord(json)) throw new TypeError("an object");
  return json;
}

function list(json: unknown): readonly unknown[] {
  if (!Array.isArray(json)) throw new TypeError("a list");
  return json;
}

function text(json: unknown): string {
  if (typeof json !== "string") throw new TypeError("a text");
  return json;
}

function finite(json: unknown): number {
  if (typeof json !== "number" || !Number.isFinite(json)) throw new TypeError("a number");
  return json;
}

function finiteOrNull(json: unknown): number | null {
  return json === null ? null : finite(json);
}

function place(json: unknown): Place {
  const [x, y] = list(json);
  return [finite(x), finite(y)];
}

function four(json: unknown): readonly [number, number, number, number] {
  const [a, b, c, d] = list(json);
  return [finite(a), finite(b), finite(c), finite(d)];
}
