// The link's guarantees, on random bytes and words.

import { randomBytes } from "node:crypto";
import fc from "fast-check";
import { describe, expect, test } from "vitest";
import {
  CacheFull,
  deriveEpoch,
  IV_BYTES,
  Link,
  OpenError,
  open,
  Pin,
  parseQrUrl,
  ReplayCache,
  Replayed,
  SERVER_MAX_BYTES,
  Stale,
  seal,
  sealJwe,
  UsageError,
} from "../client/core";
import { decodeBase64url, encodeBase64url } from "../client/core/base64url";

const bytes = new TextEncoder();
const NOW = 1_700_000_000;
const PIN = new Pin("123456789012");
const OTHER = new Pin("210987654321");
const epoch = deriveEpoch(PIN);

const iv = () => new Uint8Array(randomBytes(IV_BYTES));
const aByte = fc.uint8Array({ minLength: 0, maxLength: 400 });

function openIt(token: Uint8Array, now_s = NOW, cache = new ReplayCache(100, 30)) {
  return open(token, epoch, now_s, cache, SERVER_MAX_BYTES, true);
}

function reasonOf(run: () => unknown): string {
  try {
    run();
    return "ok";
  } catch (error) {
    expect(error).toBeInstanceOf(OpenError);
    return (error as OpenError).reason;
  }
}

describe("secrets", () => {
  test("printing a pin, a key or an epoch shows no secret", () => {
    const shown = [
      String(PIN),
      JSON.stringify(epoch),
      String(epoch.key),
      Object.values(PIN).join(),
      Object.keys(epoch.key).join(),
    ];
    expect(shown.join(" ")).not.toMatch(/123456789012|fd42/);
    expect(JSON.stringify(epoch)).toContain("<Pin>");
  });
});

describe("base64url", () => {
  test("agrees with Node, and reads back what it wrote", () => {
    fc.assert(
      fc.property(aByte, (raw) => {
        const text = encodeBase64url(raw);
        expect(text).toBe(Buffer.from(raw).toString("base64url"));
        expect(decodeBase64url(bytes.encode(text))).toEqual(raw);
      }),
    );
  });

  test("reads no second spelling of any bytes", () => {
    fc.assert(
      fc.property(fc.string({ maxLength: 12, unit: fc.constantFrom(...Array.from("AQgwBZaz09-_+/= \n")) }), (text) => {
        const raw = decodeBase64url(bytes.encode(text));
        if (raw) expect(encodeBase64url(raw)).toBe(text);
      }),
      { numRuns: 600 },
    );
  });
});

describe("envelope", () => {
  test("opens what was sealed", () => {
    fc.assert(
      fc.property(fc.jsonValue(), (payload) => {
        const plain: unknown = JSON.parse(JSON.stringify(payload));
        expect(openIt(seal(payload, NOW, epoch, iv()))).toEqual({ kind: "envelope", timestamp_s: NOW, payload: plain });
      }),
    );
  });

  test("garbage is refused with an OpenError and nothing else", () => {
    fc.assert(
      fc.property(aByte, (token) => {
        expect(reasonOf(() => openIt(token))).toBe("malformed_jwe");
      }),
    );
  });

  test("authentic garbage is refused with an OpenError and nothing else", () => {
    const words = fc.oneof(
      aByte,
      fc.json().map((text) => bytes.encode(text)),
      fc
        .record({
          timestamp: fc.oneof(fc.jsonValue(), fc.constant(NOW)),
          payload: fc.jsonValue(),
          cmd: fc.constant(255),
        })
        .map((object) => bytes.encode(JSON.stringify(object))),
    );
    fc.assert(
      fc.property(words, (plaintext) => {
        reasonOf(() => openIt(sealJwe(plaintext, epoch.key, iv())));
      }),
      { numRuns: 100 },
    );
  });

  test("no altered byte of a message is accepted", () => {
    const token = seal({ cmd: 16 }, NOW, epoch, iv());
    fc.assert(
      fc.property(fc.nat(token.length - 1), fc.integer({ min: 1, max: 255 }), (at, flip) => {
        const forged = token.slice();
        forged[at] = (forged[at] ?? 0) ^ flip;
        expect(["malformed_jwe", "not_authentic"]).toContain(reasonOf(() => openIt(forged)));
      }),
      { numRuns: 100 },
    );
  });

  test("no part of a message is accepted", () => {
    const token = seal({ cmd: 16 }, NOW, epoch, iv());
    for (let length = 0; length < token.length; length += 1) {
      expect(["malformed_jwe", "not_authentic"]).toContain(reasonOf(() => openIt(token.slice(0, length))));
    }
  });

  test("a stale message tells by how much, the clock of the sender being ahead counting as positive", () => {
    for (const skew of [31, -31, 4000, -4000]) {
      try {
        openIt(seal(1, NOW + skew, epoch, iv()));
        expect.unreachable();
      } catch (error) {
        expect((error as OpenError).cause).toBeInstanceOf(Stale);
        expect((error as OpenError).skew_s).toBe(skew);
      }
    }
    expect(reasonOf(() => openIt(seal(1, NOW + 30, epoch, iv())))).toBe("ok");
  });

  test("an unauthentic message tells nothing of clocks", () => {
    const foreign = seal(1, NOW - 500, deriveEpoch(OTHER), iv());
    try {
      openIt(foreign);
      expect.unreachable();
    } catch (error) {
      expect((error as OpenError).skew_s).toBeUndefined();
    }
  });
});

describe("replay cache", () => {
  test("whatever the order and the clock, no message passes twice", () => {
    const step = fc.record({
      iv: fc.nat(5),
      timestamp: fc.integer({ min: 0, max: 200 }),
      now: fc.integer({ min: 0, max: 300 }),
    });
    fc.assert(
      fc.property(fc.array(step, { maxLength: 60 }), (steps) => {
        const cache = new ReplayCache(100, 30);
        const passed = new Set<string>();
        for (const { iv: number, timestamp, now } of steps) {
          // One IV is one message, with one timestamp: the sender is honest and the broker is not.
          const message = `${number}:${timestamp}`;
          try {
            cache.enter("e", message, timestamp, now);
          } catch (error) {
            expect([Stale, Replayed]).toContain((error as object).constructor);
            continue;
          }
          expect(passed).not.toContain(message);
          passed.add(message);
        }
      }),
      { numRuns: 100 },
    );
  });

  test("is bounded, refuses when full, and lives again", () => {
    const cache = new ReplayCache(50, 30);
    for (let i = 0; i < 50; i += 1) cache.enter("e", String(i), NOW, NOW);
    expect(() => cache.enter("e", "more", NOW, NOW)).toThrow(CacheFull);
    expect(cache.size).toBe(50);
    cache.enter("e", "later", NOW + 62, NOW + 62);
    expect(cache.size).toBe(1);
  });
});

describe("link", () => {
  const notify = (e = epoch) => `/qrkey/${e.topic}/notify`;
  const make = () => new Link("/qrkey", PIN, "me");
  const pinMessage = (pin: Pin, under = epoch) =>
    sealJwe(bytes.encode(JSON.stringify({ cmd: 255, pin_code: pin.reveal() })), under.key, iv());

  test("a burst of messages, dated over the whole window, blinds it to nothing that comes a moment later", () => {
    const link = make();
    const ahead = Array.from({ length: 4500 }, (_, i) => seal({ cmd: 1 }, NOW - 29 + (i % 59), epoch, iv()));
    const kinds = new Set(ahead.map((message) => link.receive(notify(), message, NOW).kind));
    expect(kinds).toEqual(new Set(["notified", "rejected"]));
    expect([...link.rejected.keys()]).toEqual(["cache_full"]);
    for (let tenth = 1; tenth < 600; tenth += 1) {
      const now = NOW + tenth / 10;
      const heard = link.receive(notify(), seal({ cmd: 1 }, now, epoch, iv()), now).kind;
      expect(heard, `${tenth} tenths later`).toBe("notified");
    }
  });

  test("reads notifications, and its own replies", () => {
    const link = make();
    expect(link.receive(notify(), seal({ cmd: 1 }, NOW, epoch, iv()), NOW)).toEqual({
      kind: "notified",
      timestamp_s: NOW,
      payload: { cmd: 1 },
    });
    const answer = seal({ request: 0, data: [] }, NOW, epoch, iv());
    expect(link.receive(`/qrkey/${epoch.topic}/reply/me`, answer, NOW)).toEqual({
      kind: "replied",
      timestamp_s: NOW,
      request: 0,
      data: [],
    });
    expect(link.rejected.size).toBe(0);
  });

  test("refuses what is not for it, or makes no sense, and counts it by reason", () => {
    const link = make();
    const good = () => seal({ request: 0, data: [] }, NOW, epoch, iv());
    const base = `/qrkey/${epoch.topic}`;
    const cases: [string, Uint8Array, string][] = [
      [`${base}/reply/you`, good(), "wrong_topic"],
      [`${base}/request`, good(), "wrong_topic"],
      [`${base}/command/0000/A/0/move_raw`, good(), "wrong_topic"],
      ["/other/topic", good(), "wrong_topic"],
      [`${base}/reply/me`, seal({ request: 0.5, data: [] }, NOW, epoch, iv()), "bad_payload"],
      [`${base}/reply/me`, seal({ request: 0 }, NOW, epoch, iv()), "bad_payload"],
      [`${base}/reply/me`, seal("0", NOW, epoch, iv()), "bad_payload"],
      [`${base}/reply/me`, pinMessage(OTHER), "malformed_envelope"],
      [notify(), seal(1, NOW - 31, epoch, iv()), "stale"],
      [notify(), new Uint8Array(3_000_000), "too_large"],
    ];
    for (const [topic, token, reason] of cases) {
      expect(link.receive(topic, token, NOW)).toMatchObject({ kind: "rejected", reason });
    }
    expect(Object.fromEntries(link.rejected)).toEqual({
      wrong_topic: 4,
      bad_payload: 3,
      malformed_envelope: 1,
      stale: 1,
      too_large: 1,
    });
  });

  test("a replayed notification has no second effect", () => {
    const link = make();
    const token = seal({ cmd: 1 }, NOW, epoch, iv());
    expect(link.receive(notify(), token, NOW).kind).toBe("notified");
    expect(link.receive(notify(), token, NOW + 20)).toEqual({ kind: "rejected", reason: "replayed" });
    expect(link.receive(`/qrkey/${epoch.topic}/reply/me`, token, NOW)).toEqual({
      kind: "rejected",
      reason: "replayed",
    });
  });

  test("moves with the pin: new topics, new key, and deaf to the old epoch", () => {
    const link = make();
    const before = link.subscriptions;
    const next = deriveEpoch(OTHER);
    // However late it comes: a phone that slept gets it with an old clock, too.
    const event = link.receive(notify(), pinMessage(OTHER), NOW + 5000);
    expect(event).toEqual({ kind: "moved", subscribe: link.subscriptions, unsubscribe: before });
    expect(link.subscriptions).toEqual([notify(next), `/qrkey/${next.topic}/reply/me`]);
    expect(link.pin.equals(OTHER)).toBe(true);
    expect(link.receive(notify(), seal(1, NOW, epoch, iv()), NOW)).toMatchObject({ reason: "wrong_topic" });
    expect(link.receive(notify(), pinMessage(PIN), NOW)).toMatchObject({ reason: "wrong_topic" });
    expect(link.receive(notify(next), seal(1, NOW, next, iv()), NOW).kind).toBe("notified");
    const { topic, bytes: sealed } = link.command("A", "0", "rgb_led", { red: 1 }, NOW, iv());
    expect(topic).toBe(`/qrkey/${next.topic}/command/0000/A/0/rgb_led`);
    expect(open(sealed, next, NOW, new ReplayCache(1, 30), SERVER_MAX_BYTES, false)).toMatchObject({
      payload: { red: 1 },
    });
  });

  test("falls back from an epoch in which nobody speaks, and only from there", () => {
    const link = make();
    expect(link.fallBack(link.pin)).toBeUndefined();
    const next = deriveEpoch(OTHER);
    link.receive(notify(), pinMessage(OTHER), NOW);
    const astray = link.subscriptions;
    expect(link.fallBack(epoch.pin)).toBeUndefined();
    expect(link.fallBack(link.pin)).toEqual({ kind: "moved", subscribe: link.subscriptions, unsubscribe: astray });
    expect(link.pin.equals(PIN)).toBe(true);
    expect(link.fallBack(link.pin)).toBeUndefined();
    link.receive(notify(), pinMessage(OTHER), NOW);
    expect(link.receive(notify(next), seal(1, NOW, next, iv()), NOW).kind).toBe("notified");
    expect(link.fallBack(link.pin)).toBeUndefined();
  });

  test("a pin message under another key, or to the pin it has, moves nothing", () => {
    const link = make();
    expect(link.receive(notify(), pinMessage(OTHER, deriveEpoch(OTHER)), NOW)).toMatchObject({
      reason: "not_authentic",
    });
    expect(link.receive(notify(), pinMessage(PIN), NOW)).toMatchObject({ reason: "bad_payload" });
    expect(link.pin.equals(PIN)).toBe(true);
  });

  test("a request names its sender, whatever else it carries", () => {
    const { topic, bytes: sealed } = make().request(0, { frames: true, reply: "you", request: 7 }, NOW, iv());
    expect(topic).toBe(`/qrkey/${epoch.topic}/request`);
    const opened = openIt(sealed);
    expect(opened).toMatchObject({ payload: { frames: true, request: 0, reply: "me" } });
  });

  test("nothing is sent that a server would refuse for its size", () => {
    const frame = JSON.stringify({ timestamp: NOW, payload: "", sub: "command/0000/A/0/x" }).length;
    const largest = "y".repeat(SERVER_MAX_BYTES - frame);
    expect(() => make().command("A", "0", "x", largest, NOW, iv())).not.toThrow();
    expect(() => make().command("A", "0", "x", `${largest}y`, NOW, iv())).toThrow(UsageError);
  });

  test("never throws, whatever arrives where", () => {
    const topics = fc.oneof(fc.constantFrom(...make().subscriptions), fc.string());
    const tokens = fc.oneof(
      aByte,
      fc.jsonValue().map((payload) => seal(payload, NOW, epoch, iv())),
      fc.json().map((text) => sealJwe(bytes.encode(text), epoch.key, iv())),
    );
    fc.assert(
      fc.property(topics, tokens, fc.double(), (topic, token, now_s) => {
        expect(["notified", "replied", "rejected"]).toContain(make().receive(topic, token, now_s).kind);
      }),
      { numRuns: 100 },
    );
  });
});

describe("QR url", () => {
  test("whatever is scanned, only a UsageError comes, and it never repeats the pin", () => {
    const word = fc.oneof(fc.string(), fc.constantFrom("1", "5", "ws://h:1/mqtt", "/qrkey", "987654321098"));
    const url = fc
      .tuple(word, word, word, word)
      .map(([pin, broker, root, mqtt]) => `http://p/#v=1&pin=${pin}&broker=${broker}&root=${root}&mqtt=${mqtt}`);
    fc.assert(
      fc.property(fc.oneof(url, fc.string(), fc.webUrl()), (text) => {
        try {
          expect(parseQrUrl(text).broker).toMatch(/^wss?:/);
        } catch (error) {
          expect(error).toBeInstanceOf(UsageError);
          expect((error as Error).message).not.toContain("987654321098");
        }
      }),
      { numRuns: 100 },
    );
  });

  test("two pins in one link are refused", () => {
    const twice = "http://p/#v=1&pin=111111&pin=222222&broker=ws%3A%2F%2Fh%3A1%2Fmqtt";
    expect(() => parseQrUrl(twice)).toThrow(UsageError);
  });
});
