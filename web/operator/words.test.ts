import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { withoutCredentials } from "./link_health";
import { reason } from "./reasons";
import { ago, clock, grouped, perSecond, shortUrl } from "./words";

describe("words", () => {
  it("never let the pin out of a URL", () => {
    expect(shortUrl("http://10.0.0.5:8080/#v=1&pin=123456789012&broker=ws%3A")).toBe("10.0.0.5:8080");
    expect(shortUrl("https://example.org/PyDotBot?use_qrkey=true&pin=123456789012")).toBe("example.org/PyDotBot");
  });

  it("never let the broker's password out of a URL", () => {
    expect(withoutCredentials("wss://me:s3cret@host:443/mqtt")).toBe("wss://host:443/mqtt");
    expect(withoutCredentials("wss://me:s3@cret@host/mqtt")).toBe("wss://host/mqtt");
    expect(withoutCredentials("ws://host:9001/mqtt")).toBe("ws://host:9001/mqtt");
  });

  it("count down in full seconds", () => {
    expect([-1, 0, 0.2, 59.01, 600, 3725].map(clock)).toEqual(["0:00", "0:00", "0:01", "1:00", "10:00", "1:02:05"]);
  });

  it("say how long ago to the unit that matters", () => {
    expect([0.4, 7.9, 61, 7300, 200_000].map(ago)).toEqual(["now", "7 s", "1 min", "2 h", "2 d"]);
  });

  it("write numbers so that they can be read", () => {
    expect([7, 1234, 1_234_567].map(grouped)).toEqual(["7", "1\u202f234", "1\u202f234\u202f567"]);
    expect([0, 0.01, 0.42, 9.96, 1234].map(perSecond)).toEqual(["0", "<0.1", "0.4", "10", "1\u202f234"]);
  });

  it("explain every reason that the specification names", () => {
    const spec = readFileSync(`${import.meta.dirname}/../../docs/spec/link.md`, "utf8");
    const named = [...spec.matchAll(/^\| `[A-Z]\w+` \| `(\w+)` \|/gm)].map((match) => match[1] ?? "");
    expect(named.length).toBeGreaterThanOrEqual(11);
    for (const name of named) expect(reason(name).title, name).not.toBe(name);
  });
});
