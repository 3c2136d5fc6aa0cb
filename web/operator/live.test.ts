// The swarm out of a stream of lines, however the network cuts them.

import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Live } from "./live";

const A = "DECAFBAD00000001";
const LINES = [
  { request: 1, data: { width: 3000, height: 2000 } },
  { request: 0, data: [{ address: A, n: 1, name: "Zoë" }] },
  { cmd: 16, data: { seq: 7, changed: [{ address: A, status: 2 }] } },
];

let stop: (() => void) | undefined;
let opened = 0;

function answerWith(...pieces: readonly Uint8Array[]): void {
  vi.stubGlobal("fetch", (url: string, { headers, signal }: RequestInit) => {
    opened += 1;
    expect([url, headers]).toEqual(["/api/frames", { Authorization: "Bearer secret" }]);
    const body = new ReadableStream<Uint8Array>({
      start(to) {
        for (const piece of pieces) to.enqueue(piece);
        stop = () => to.close();
        signal?.addEventListener("abort", () => to.error(new Error("aborted")));
      },
    });
    return Promise.resolve(new Response(body));
  });
}

beforeEach(() => {
  opened = 0;
});
afterEach(() => vi.unstubAllGlobals());

describe("the live swarm", () => {
  it("is read from lines that are cut anywhere, also within a letter", async () => {
    const whole = new TextEncoder().encode(LINES.map((line) => `${JSON.stringify(line)}\n`).join(""));
    answerWith(...Array.from(whole, (_, i) => whole.slice(i, i + 1)));
    const live = new Live("secret");
    await vi.waitFor(() => expect(live.view.swarm.seq).toBe(7), 30_000);
    expect(live.view.swarm.area).toMatchObject({ width: 3000, height: 2000 });
    expect(live.view.swarm.robots.get(A)).toMatchObject({ name: "Zoë", status: 2 });
    live.close();
  });

  it("is asked for again when the gateway hangs up or talks nonsense, and no more once closed", async () => {
    answerWith(new TextEncoder().encode("nonsense\n"));
    const live = new Live("secret");
    await vi.waitFor(() => expect(opened).toBe(2), 30_000);
    answerWith();
    await vi.waitFor(() => expect(opened).toBe(3), 30_000);
    stop?.();
    await vi.waitFor(() => expect(opened).toBe(4), 30_000);
    live.close();
    await new Promise((resolve) => setTimeout(resolve, 700));
    expect(opened).toBe(4);
  });
});
