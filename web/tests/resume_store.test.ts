// Where the secret to resume with is kept, how long, and what a spoilt storage costs.

import { describe, expect, test } from "vitest";
import { DIRECT, ResumeStore, Secret } from "../client";

const SWARM = new Uint8Array(32).fill(7);
const OTHER = new Uint8Array(32).fill(8);
const HOUR_S = 3600;

class Memory implements Storage {
  readonly #all = new Map<string, string>();
  get length(): number {
    return this.#all.size;
  }
  key(i: number): string | null {
    return [...this.#all.keys()][i] ?? null;
  }
  getItem(key: string): string | null {
    return this.#all.get(key) ?? null;
  }
  setItem(key: string, value: string): void {
    this.#all.set(key, value);
  }
  removeItem(key: string): void {
    this.#all.delete(key);
  }
  clear(): void {
    this.#all.clear();
  }
}

function kept(n: number, fixed = SWARM) {
  return { fixed, at: DIRECT, secret: new Secret("resume", new Uint8Array(32).fill(n)), name: "Ada", tab: "t" };
}

describe("a resume secret", () => {
  test("is kept by the swarm's key, on https in all tabs for as long as the server says", () => {
    const [local, tab] = [new Memory(), new Memory()];
    const store = new ResumeStore({ isSecure: true, local, tab });
    store.keep(kept(1), 8 * HOUR_S, 1000);
    store.keep(kept(2, OTHER), 8 * HOUR_S, 2000);
    expect([local.length, tab.length]).toEqual([2, 0]);
    const again = new ResumeStore({ isSecure: true, local, tab: new Memory() });
    expect(again.find(SWARM, 1000 + 8 * HOUR_S - 1)?.secret.reveal()).toEqual(new Uint8Array(32).fill(1));
    expect(again.find(OTHER, 3000)).toMatchObject({ name: "Ada", tab: "t" });
    expect(again.find(SWARM, 1000 + 8 * HOUR_S)).toBeUndefined();
    expect(local.length).toBe(1);
  });

  test("is kept on plain http for an hour at most, in this tab alone", () => {
    const [local, tab] = [new Memory(), new Memory()];
    const store = new ResumeStore({ isSecure: false, local, tab });
    store.keep(kept(1), 8 * HOUR_S, 1000);
    expect([local.length, tab.length]).toEqual([0, 1]);
    expect(store.find(SWARM, 1000 + HOUR_S - 1)).toBeDefined();
    expect(store.find(SWARM, 1000 + HOUR_S)).toBeUndefined();
    store.keep(kept(1), 60, 1000);
    expect(store.find(SWARM, 1060)).toBeUndefined();
  });

  test("of the swarm that was visited last is found without its key", () => {
    const store = new ResumeStore({ isSecure: true, local: new Memory(), tab: undefined });
    expect(store.newest(0)).toBeUndefined();
    store.keep(kept(1), HOUR_S, 3000);
    store.keep(kept(2, OTHER), HOUR_S, 2000);
    expect(store.newest(3000)?.fixed).toEqual(SWARM);
    store.forget(SWARM);
    expect(store.newest(3000)?.fixed).toEqual(OTHER);
  });

  test("does not live longer because a clock was set back", () => {
    const store = new ResumeStore({ isSecure: true, local: new Memory(), tab: undefined });
    store.keep(kept(1), HOUR_S, 10_000);
    expect(store.find(SWARM, 9_990)).toBeDefined();
    expect(store.find(SWARM, 5_000)).toBeUndefined();
  });

  test.each(["", "null", "7", "{}", '{"secret":"AA","kept_s":0,"until_s":9}', '{"secret":7,"kept_s":0,"until_s":9}', "{"])(
    "that is spoilt is none, and is removed: %s",
    (text) => {
      const local = new Memory();
      const store = new ResumeStore({ isSecure: true, local, tab: undefined });
      store.keep(kept(1), HOUR_S, 0);
      local.setItem(local.key(0) ?? "", text);
      expect(store.find(SWARM, 1)).toBeUndefined();
      expect(local.length).toBe(0);
    },
  );

  test("costs no more than a scan where storage is full or forbidden", () => {
    const refuse = () => {
      throw new Error("full");
    };
    const broken = { getItem: refuse, setItem: refuse, removeItem: refuse, key: refuse, clear: refuse, length: 1 };
    for (const local of [broken, undefined]) {
      const store = new ResumeStore({ isSecure: true, local, tab: undefined });
      expect(() => store.keep(kept(1), HOUR_S, 0)).not.toThrow();
      expect([store.find(SWARM, 0), store.newest(0)]).toEqual([undefined, undefined]);
      expect(() => store.forget(SWARM)).not.toThrow();
    }
  });
});
