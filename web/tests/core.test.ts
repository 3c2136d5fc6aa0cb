// What both ends read strictly: base64url, and JSON.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { decodeBase64url, encodeBase64url } from "../client/core/base64url";
import { BadPayload } from "../client/core/errors";
import { parseJson } from "../client/core/json";

const bytes = new TextEncoder();
const parsed = (text: string): unknown => parseJson(bytes.encode(text));

describe("base64url", () => {
  test("agrees with Node, and reads back what it wrote", () => {
    fc.assert(
      fc.property(fc.uint8Array({ maxLength: 400 }), (raw) => {
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

describe("JSON", () => {
  test("is read as it was written", () => {
    fc.assert(
      fc.property(fc.json(), (text) => {
        expect(parsed(text)).toEqual(JSON.parse(text));
      }),
    );
  });

  test("garbage is refused as bad payload and nothing else", () => {
    const garbage = fc.oneof(fc.uint8Array({ maxLength: 400 }), fc.json().map((text) => bytes.encode(text.slice(1))));
    fc.assert(
      fc.property(garbage, (raw) => {
        try {
          parseJson(raw);
        } catch (error) {
          expect(error).toBeInstanceOf(BadPayload);
        }
      }),
    );
  });

  test("a key twice, a byte order mark, or too deep is refused", () => {
    const twice = ['{"a":1,"a":2}', '{"a":1,"\\u0061":2}', '[{"b":{},"b":[]}]'];
    for (const text of [...twice, "\ufeff1", "[".repeat(201) + "]".repeat(201), "NaN", "", "'a'"]) {
      expect(() => parsed(text), text).toThrow(BadPayload);
    }
    expect(() => parseJson(Uint8Array.of(0x22, 0xff, 0x22))).toThrow(BadPayload);
    expect(parsed('{"a":{"a":1},"b":"{a:1,a:2}"}')).toEqual({ a: { a: 1 }, b: "{a:1,a:2}" });
    expect(parsed("[".repeat(200) + "]".repeat(200))).toBeInstanceOf(Array);
  });
});
