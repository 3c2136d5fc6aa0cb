// The shared vectors: the same cases decide what Python and this client accept, and by which name they refuse.

import { readFileSync } from "node:fs";
import { bytesToHex, hexToBytes } from "@noble/hashes/utils.js";
import { describe, expect, test } from "vitest";
import {
  deriveEpoch,
  type Epoch,
  fullTopic,
  type Json,
  type JsonObject,
  Key,
  OpenError,
  open,
  openJwe,
  Pin,
  PartsInbox,
  parseQrUrl,
  qrFragment,
  ReplayCache,
  type SubTopic,
  seal,
  sealJwe,
  splitTopic,
} from "../client/core";
import { readPlaces, readRoute } from "../client/places";

interface Case {
  readonly name: string;
  readonly expect: string;
}

// The type says what the file's cases hold; the file is ours.
// eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters
function load<C extends Case>(file: string): readonly C[] {
  const text = readFileSync(`${import.meta.dirname}/../../vectors/${file}.json`, "utf8");
  const { cases } = JSON.parse(text) as { cases: readonly C[] };
  expect(cases.length).toBeGreaterThan(0);
  return cases;
}

/** The name of what `run` throws, or "ok" with its result. */
function outcome<T>(run: () => T): { name: string; result?: T } {
  try {
    return { name: "ok", result: run() };
  } catch (error) {
    if (error instanceof OpenError) return { name: error.cause.name };
    return { name: (error as Error).name };
  }
}

const bytes = new TextEncoder();

function epochOf(key_hex: string): Epoch {
  return { pin: new Pin("0000"), topic: "test", key: new Key(hexToBytes(key_hex)) };
}

describe("keys", () => {
  test.each(load<Case & { pin: string; topic: string; key_hex: string }>("keys"))("$name", (c) => {
    const { name, result } = outcome(() => deriveEpoch(new Pin(c.pin)));
    expect(name).toBe(c.expect);
    if (result) {
      expect(result.topic).toBe(c.topic);
      expect(bytesToHex(result.key.reveal())).toBe(c.key_hex);
    }
  });
});

describe("envelope", () => {
  type C = Case & {
    key_hex: string;
    iv_hex: string;
    now: number;
    max_bytes: number;
    jwe: string;
    plaintext?: string;
    timestamp?: number;
    payload?: unknown;
  };
  test.each(load<C>("envelope"))("$name", (c) => {
    const epoch = epochOf(c.key_hex);
    const cache = new ReplayCache(10, 30);
    const { name, result } = outcome(() => open(bytes.encode(c.jwe), epoch, c.now, cache, c.max_bytes, false));
    expect(name).toBe(c.expect);
    if (c.expect !== "ok") return;
    expect(result).toEqual({ kind: "envelope", timestamp_s: c.timestamp, payload: c.payload });
    const resealed = sealJwe(bytes.encode(c.plaintext), epoch.key, hexToBytes(c.iv_hex));
    expect(new TextDecoder().decode(resealed)).toBe(c.jwe);
  });

  test("what is refused as not authentic is opened by no other path", () => {
    const altered = load<C>("envelope").filter((c) => c.expect === "NotAuthentic");
    expect(altered.length).toBeGreaterThan(3);
    for (const c of altered) {
      expect(outcome(() => openJwe(bytes.encode(c.jwe), epochOf(c.key_hex).key, c.max_bytes)).name).toBe(
        "NotAuthentic",
      );
    }
  });
});

describe("bound", () => {
  type C = Case & { key_hex: string; iv_hex: string; now: number; jwe: string; payload: Json; sub: string; seen: number | null };
  // Clients write it; only servers read it.
  const ours = load<C>("bound").filter((c) => c.expect === "ok");
  test.each(ours)("$name", ({ payload, now, key_hex, iv_hex, jwe, sub, seen }) => {
    const bound = { sub, seen: seen ?? undefined };
    const sealed = seal(payload, now, epochOf(key_hex), hexToBytes(iv_hex), 4096, bound);
    expect(new TextDecoder().decode(sealed)).toBe(jwe);
  });
});

describe("pin message", () => {
  test.each(load<Case & { plaintext: string; pin?: string }>("pin_message"))("$name", (c) => {
    const epoch = epochOf("00".repeat(32));
    const jwe = sealJwe(bytes.encode(c.plaintext), epoch.key, new Uint8Array(12));
    const { name, result } = outcome(() => open(jwe, epoch, 0, new ReplayCache(10, 30), 4096, true));
    expect(name).toBe(c.expect);
    if (c.expect === "ok") {
      expect(result?.kind).toBe("pin");
      if (result?.kind === "pin") expect(result.pin.reveal()).toBe(c.pin);
    }
  });
});

describe("topics", () => {
  type C = Case & {
    root: string;
    topic: string;
    full: string;
    kind?: string;
    address?: string;
    application?: string;
    command?: string;
    client_id?: string;
  };
  test.each(load<C>("topics"))("$name", (c) => {
    const { name, result } = outcome(() => splitTopic(c.root, c.topic, c.full));
    expect(name).toBe(c.expect);
    if (!result) return;
    const { kind, address, application, command, client_id } = c;
    const words = { kind, address, application, name: command, client_id };
    expect(result).toEqual(Object.fromEntries(Object.entries(words).filter(([, word]) => word !== undefined)));
    expect(fullTopic(c.root, c.topic, result)).toBe(c.full);
  });

  test("words outside the grammar never make a topic", () => {
    const bad: SubTopic[] = [
      { kind: "reply", client_id: "a/b" },
      { kind: "reply", client_id: "" },
      { kind: "command", address: "+", application: "0", name: "x" },
      { kind: "command", address: "A", application: "0", name: "#" },
      { kind: "command", address: "A", application: "", name: "x" },
    ];
    for (const sub of bad) expect(outcome(() => fullTopic("/qrkey", "t", sub)).name).toBe("WrongTopic");
  });
});

describe("replay", () => {
  interface Step {
    now: number;
    epoch: string;
    iv: string;
    timestamp: number;
    expect: string;
  }
  test.each(load<Case & { capacity: number; steps: Step[] }>("replay"))("$name", (c) => {
    const cache = new ReplayCache(c.capacity, 30);
    const outcomes = c.steps.map((s) => outcome(() => cache.enter(s.epoch, s.iv, s.timestamp, s.now)).name);
    expect(outcomes).toEqual(c.steps.map((s) => s.expect));
  });
});

describe("parts", () => {
  interface Step {
    words: JsonObject;
    expect: string;
    whole?: unknown[];
  }
  test.each(load<Case & { steps: Step[] }>("parts"))("$name", (c) => {
    const inbox = new PartsInbox();
    for (const step of c.steps) {
      let whole: unknown[] | undefined;
      const { name } = outcome(() => {
        whole = inbox.take(0, step.words);
      });
      expect(name === "ok" ? (whole ? "whole" : "part") : name).toBe(step.expect);
      if (step.whole) expect(whole).toEqual(step.whole);
    }
  });
});

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

describe("QR url", () => {
  type C = Case & { url: string; pin: string; broker: string; root: string; mqtt: number; login?: object };
  test.each(load<C>("qrurl"))("$name", (c) => {
    const { name, result } = outcome(() => parseQrUrl(c.url));
    expect(name).toBe(c.expect);
    if (!result) return;
    const plain = { ...result, pin: result.pin.reveal() };
    expect(plain).toEqual({
      pin: c.pin,
      broker: c.broker,
      root: c.root,
      mqtt: c.mqtt,
      ...(c.login && { login: c.login }),
    });
    const again = parseQrUrl(`http://page/${qrFragment(result)}`);
    expect({ ...again, pin: again.pin.reveal() }).toEqual(plain);
  });
});
