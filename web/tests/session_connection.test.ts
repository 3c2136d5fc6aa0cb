// A session's websocket: what is tried when, what ends it for good, and the constant rate.

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { type BrokerState, DIRECT, ResumeStore, Secret, SessionConnection, type Standing, type TransportEvent, Unanswered } from "../client";
import type { Way } from "../client/io/websocket_way";
import type { SessionEvent } from "../client/session";

const A = "DECAFBAD00000001";
const SWARM = new Uint8Array(32).fill(7);

interface Sent {
  readonly at_ms: number;
  readonly what: string;
}

/** Stands in for the pure session, which has tests of its own. */
const { FakeSession } = vi.hoisted(() => {
  const said = (what: string): SessionEvent => ({ kind: "transmit", data: new TextEncoder().encode(what), topic: "" });
  return {
    FakeSession: class FakeSession {
      static all: FakeSession[] = [];
      readonly rejected = new Map<string, number>();
      readonly secret: Secret;
      isJoined = false;
      hasSeen = false;
      due: SessionEvent[] = [];
      events: SessionEvent[] = [];

      constructor(invitation: { readonly secret: Secret }) {
        this.secret = invitation.secret;
        FakeSession.all.push(this);
      }
      start(): SessionEvent[] {
        return [said(`hello ${this.secret.kind} ${this.secret.reveal()[0] ?? ""}`)];
      }
      receive(): SessionEvent[] {
        return this.events.splice(0);
      }
      tick(): SessionEvent[] {
        return this.due.splice(0);
      }
      command(_robot: string, name: string, payload: Uint8Array, _now_ms: number, stop = false): SessionEvent {
        return said(stop ? "stop" : `${name} ${new TextDecoder().decode(payload)}`);
      }
      alive(): SessionEvent {
        return said("alive");
      }
      request(name: string): { number: number; event: SessionEvent } {
        return { number: 1, event: said(`ask ${name}`) };
      }
      stored(): SessionEvent {
        return said("stored");
      }
      leave(): SessionEvent[] {
        return [said("leave"), { kind: "ended", reason: undefined }];
      }
    },
  };
});

vi.mock("../client/session/session", () => ({ Session: FakeSession }));

class FakeSocket {
  static all: FakeSocket[] = [];
  static readonly OPEN = 1;
  readonly sent: Sent[] = [];
  readyState = 0;
  onopen = () => {};
  onclose: (event: { reason: string }) => void = () => {};
  onmessage: (event: { data: ArrayBuffer }) => void = () => {};

  constructor() {
    FakeSocket.all.push(this);
  }
  open(): void {
    this.readyState = 1;
    this.onopen();
  }
  send(bytes: Uint8Array): void {
    this.sent.push({ at_ms: performance.now(), what: new TextDecoder().decode(bytes) });
  }
  /** This side closes: the browser tells so later, when nobody listens any more. */
  close(): void {
    this.readyState = 3;
  }
  /** The server closes. */
  end(reason = ""): void {
    this.readyState = 3;
    this.onclose({ reason });
  }
}

function said(what: string): SessionEvent {
  return { kind: "transmit", data: new TextEncoder().encode(what), topic: "" };
}

const stored = new Map<string, string>();
const storage: Storage = {
  get length() {
    return stored.size;
  },
  key: (i) => [...stored.keys()][i] ?? null,
  getItem: (key) => stored.get(key) ?? null,
  setItem: (key, value) => void stored.set(key, value),
  removeItem: (key) => void stored.delete(key),
  clear: () => stored.clear(),
};
const store = new ResumeStore({ isSecure: true, local: storage, tab: undefined });
const DRIVES: Standing = { role: "drive", waiting: false, place: 0, left_ms: 0, robot: "" };

let connection: SessionConnection;
let heard: TransportEvent[];

const secret = (kind: "open" | "ticket" | "room" | "resume", first: number) =>
  new Secret(kind, new Uint8Array(kind === "resume" ? 32 : 16).fill(first));
const socket = () => FakeSocket.all.at(-1) as FakeSocket;
const session = () => FakeSession.all.at(-1) as InstanceType<typeof FakeSession>;
const hellos = () => FakeSocket.all.flatMap(({ sent }) => sent.filter(({ what }) => what.startsWith("hello")).map(({ what }) => what.slice(6)));
const whats = () => socket().sent.map(({ what }) => what);
const states = () => heard.flatMap((event): BrokerState[] => (event.kind === "broker" ? [event.state] : []));
const over = () => connection.visit.over;

function begin(invitation: Secret | undefined = secret("open", 1)): void {
  connection = new SessionConnection({ url: "ws://h/link", at: DIRECT, fixed: SWARM, invitation, name: "Ada" }, store);
  heard = [];
  connection.listen((event) => heard.push(event));
}

function hear(...events: SessionEvent[]): void {
  session().events.push(...events);
  socket().onmessage({ data: new ArrayBuffer(0) });
}

/** Admitted, with a first update. */
function admitted(standing: Standing = DRIVES, resume = 9): void {
  session().isJoined = true;
  session().hasSeen = true;
  hear(
    { kind: "admitted", visitor: 1, name: "Ada 2" },
    { kind: "keep", secret: secret("resume", resume), lifetime_s: 3600 },
    { kind: "stands", standing },
  );
}

function join(standing?: Standing): void {
  begin();
  socket().open();
  admitted(standing);
}

/** The server refuses what is tried, and the page tries again. */
function refuse(reason = "unknown_secret"): void {
  socket().open();
  socket().end(reason);
  vi.advanceTimersByTime(5000);
}

beforeEach(() => {
  vi.useFakeTimers({ now: 1_700_000_000_000 });
  vi.spyOn(Math, "random").mockReturnValue(0.5);
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSession.all = [];
  FakeSocket.all = [];
  stored.clear();
});

afterEach(() => {
  connection.close();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
  vi.useRealTimers();
});

describe("joining", () => {
  test("joins with the code, keeps the secret and says so, and shows its standing", () => {
    join({ ...DRIVES, robot: A });
    expect(hellos()).toEqual(["open 1"]);
    expect(whats()).toContain("stored");
    expect(store.find(SWARM, Date.now() / 1000)).toMatchObject({ name: "Ada 2" });
    expect(connection.visit).toMatchObject({ stage: "here", name: "Ada 2", standing: { robot: A } });
    expect(states()).toEqual(["online"]);
  });

  test("who waits for approval is not online", () => {
    join({ ...DRIVES, waiting: true });
    expect(states()).toEqual(["waiting"]);
    hear({ kind: "stands", standing: DRIVES });
    expect(states()).toEqual(["waiting", "online"]);
  });

  test("who was here resumes; a ticket and a room code say more than that", () => {
    const kept = { fixed: SWARM, at: DIRECT, secret: secret("resume", 5), name: "Ada", tab: "other" };
    for (const [invitation, first] of [
      [secret("open", 1), "resume 5"],
      [secret("ticket", 2), "ticket 2"],
      [secret("room", 3), "room 3"],
      [undefined, "resume 5"],
    ] as const) {
      store.keep(kept, 3600, Date.now() / 1000);
      begin(invitation);
      socket().open();
      expect(hellos().at(-1)).toBe(first);
      connection.close();
    }
  });

  test("a code that is refused twice is over, and is not tried again", () => {
    begin();
    refuse();
    expect(over()).toBeUndefined();
    refuse();
    expect([over(), states().at(-1)]).toEqual(["code", "over"]);
    vi.advanceTimersByTime(60_000);
    expect(hellos()).toEqual(["open 1", "open 1"]);
  });

  test("a room code is tried once: each try counts", () => {
    begin(secret("room", 3));
    refuse("not_authentic");
    expect(over()).toBe("code");
    vi.advanceTimersByTime(60_000);
    expect(hellos()).toEqual(["room 3"]);
  });

  test("too many tries are told as such", () => {
    begin(secret("room", 3));
    refuse("tries_used_up");
    expect(over()).toBe("too_many");
  });

  test("a secret that is refused gives way to the code, and is forgotten", () => {
    store.keep({ fixed: SWARM, at: DIRECT, secret: secret("resume", 5), name: "Ada", tab: "other" }, 3600, Date.now() / 1000);
    begin();
    refuse();
    refuse();
    expect(store.find(SWARM, Date.now() / 1000)).toBeUndefined();
    refuse();
    expect(hellos()).toEqual(["resume 5", "resume 5", "open 1"]);
    expect(over()).toBeUndefined();
  });

  test("a connection that is only lost costs no code", () => {
    begin();
    for (let i = 0; i < 5; i += 1) refuse("");
    expect(over()).toBeUndefined();
    expect(hellos()).toEqual(Array(5).fill("open 1"));
    expect(states()).toContain("offline");
  });

  test("a server that says nothing is said to give no answer, and is tried again", () => {
    begin();
    socket().open();
    session().due.push({ kind: "ended", reason: undefined });
    vi.advanceTimersByTime(1000);
    expect(states()).toEqual(["no_answer"]);
    vi.advanceTimersByTime(5000);
    expect(FakeSocket.all).toHaveLength(2);
  });

  test("a websocket that does not open is given up", () => {
    begin();
    vi.advanceTimersByTime(5100);
    expect(states()).toEqual(["offline"]);
    vi.advanceTimersByTime(1000);
    expect(FakeSocket.all).toHaveLength(2);
  });
});

describe("the end", () => {
  test.each(["removed", "new_code"] as const)("who was %s forgets the secret, and does not come back by itself", (reason) => {
    join();
    hear({ kind: "ended", reason });
    expect([over(), store.find(SWARM, Date.now() / 1000)]).toEqual([reason, undefined]);
    connection.wake();
    connection.restart();
    vi.advanceTimersByTime(60_000);
    expect(FakeSocket.all).toHaveLength(1);
  });

  test("who was replaced keeps the secret, and comes back when asked to", () => {
    join();
    hear({ kind: "ended", reason: "replaced" });
    expect(over()).toBe("replaced");
    vi.advanceTimersByTime(60_000);
    expect(FakeSocket.all).toHaveLength(1);
    store.keep({ fixed: SWARM, at: DIRECT, secret: secret("resume", 6), name: "Ada", tab: "other" }, 3600, Date.now() / 1000);
    connection.again();
    socket().open();
    expect([hellos().at(-1), over()]).toEqual(["resume 6", undefined]);
  });

  test.each(["old_keys", "closing"] as const)("after %s it resumes", (reason) => {
    join();
    hear({ kind: "ended", reason });
    vi.advanceTimersByTime(5000);
    socket().open();
    expect(hellos()).toEqual(["open 1", "resume 9"]);
  });

  test("a code that admits no longer is over", () => {
    begin();
    socket().open();
    hear({ kind: "ended", reason: "not_admitted" });
    expect(over()).toBe("code");
  });
});

describe("a lost connection", () => {
  test("resumes with the newest secret, soon and then ever more seldom", () => {
    join();
    hear({ kind: "keep", secret: secret("resume", 10), lifetime_s: 3600 });
    const begun: number[] = [];
    for (let i = 0; i < 4; i += 1) {
      socket().end();
      const count = FakeSocket.all.length;
      const since_ms = performance.now();
      while (FakeSocket.all.length === count) vi.advanceTimersByTime(50);
      begun.push(performance.now() - since_ms);
    }
    socket().open();
    expect(hellos()).toEqual(["open 1", "resume 10"]);
    expect(begun).toEqual([250, 750, 1500, 3000]);
    expect(connection.visit).toMatchObject({ stage: "joining", name: "Ada 2" });
  });

  test("a phone that wakes up does not wait for the next try", () => {
    join();
    socket().end();
    connection.wake();
    expect(FakeSocket.all).toHaveLength(2);
  });

  test("a page that nobody sees connects when it is seen again", () => {
    join();
    connection.hide();
    socket().end();
    vi.advanceTimersByTime(60_000);
    expect(FakeSocket.all).toHaveLength(1);
    connection.wake();
    expect(FakeSocket.all).toHaveLength(2);
  });

  test("a phone that wakes up renews its keys before anything else", () => {
    join();
    session().due.push(said("rekey"));
    connection.wake();
    expect(whats().at(-1)).toBe("rekey");
  });

  test("leaves its visitor to another tab that has taken over meanwhile", () => {
    join();
    socket().end();
    store.keep({ fixed: SWARM, at: DIRECT, secret: secret("resume", 11), name: "Ada", tab: "other" }, 3600, Date.now() / 1000);
    vi.advanceTimersByTime(5000);
    expect([over(), FakeSocket.all.length]).toEqual(["replaced", 1]);
    expect(store.find(SWARM, Date.now() / 1000)).toMatchObject({ tab: "other" });
  });

  test("says nothing of before, and refuses what is asked", async () => {
    join();
    const asked = connection.request(0);
    connection.command(A, "rgb_led", {});
    connection.command(A, "waypoints", {});
    socket().end();
    await expect(asked).rejects.toBeInstanceOf(Unanswered);
    await expect(connection.request(0)).rejects.toBeInstanceOf(Unanswered);
    expect(connection.command(A, "rgb_led", {})).toBe(false);
    vi.advanceTimersByTime(5000);
    socket().open();
    admitted({ ...DRIVES, robot: A });
    vi.advanceTimersByTime(1000);
    expect(whats()).toContain("alive");
    expect(whats().filter((what) => /rgb|way/.test(what))).toEqual([]);
  });
});

describe("requests", () => {
  test("are asked by name, and answered by number; a refusal is an answer, too", async () => {
    join();
    const asked = connection.request(1);
    expect(whats().at(-1)).toBe("ask area");
    hear({ kind: "replied", number: 1, payload: new TextEncoder().encode('{"width":5}') });
    expect(await asked).toEqual({ width: 5 });
    expect(heard.at(-1)).toMatchObject({ kind: "replied", request: 1, data: { width: 5 } });
    const again = connection.request(0);
    hear({ kind: "refused", number: 1, reason: "too_many" });
    await expect(again).rejects.toThrow("too_many");
    const late = connection.request(0, 100);
    vi.advanceTimersByTime(100);
    await expect(late).rejects.toBeInstanceOf(Unanswered);
  });

  test("an answer or update that is no JSON is counted, and nothing else", () => {
    join();
    heard.length = 0;
    hear({ kind: "updated", state: Uint8Array.of(0xff) }, { kind: "updated", state: new TextEncoder().encode('{"cmd":16}') });
    expect(heard.map(({ kind }) => kind)).toEqual(["rejected", "notified"]);
  });

  test("a refused command is shown with its reason", () => {
    join();
    hear({ kind: "refused", number: 0, reason: "busy" });
    expect(connection.visit.refused).toMatchObject({ reason: "busy" });
  });
});

describe("the constant rate", () => {
  const drive = (percent: number) => connection.command(A, "move_raw", { left_y: percent, right_y: percent });
  const beats = () => socket().sent.filter(({ what }) => /^(move_raw|stop|alive|rgb_led|ask)/.test(what));
  const gaps = () => beats().map(({ at_ms }, i, all) => at_ms - (all[i - 1]?.at_ms ?? at_ms)).slice(1);

  test("with a robot there is one record every 100 ms, whether it is driven, stopped or rests", () => {
    join({ ...DRIVES, robot: A });
    vi.advanceTimersByTime(1030);
    for (let i = 0; i < 10; i += 1) {
      drive(i + 1);
      vi.advanceTimersByTime(37);
      drive(50 + i);
      vi.advanceTimersByTime(63);
    }
    vi.advanceTimersByTime(20);
    drive(0);
    const before = beats().length;
    vi.advanceTimersByTime(1000);
    expect(new Set(gaps())).toEqual(new Set([100]));
    expect(beats()[before]?.what).toBe("stop");
    expect(beats().filter(({ what }) => what === "stop")).toHaveLength(1);
    expect(beats().at(-1)?.what).toBe("alive");
    expect(beats().length).toBeGreaterThan(28);
  });

  test("what is asked takes a slot, also while the robot is driven, and an operator's stop does not wait", () => {
    join({ ...DRIVES, robot: A });
    vi.advanceTimersByTime(250);
    for (const name of ["robots", "area"]) {
      connection.ask(name).catch(() => {});
      for (let i = 0; i < 4; i += 1) {
        drive(10);
        vi.advanceTimersByTime(100);
      }
    }
    expect(new Set(gaps())).toEqual(new Set([100]));
    expect(beats().map(({ what }) => what)).toEqual(expect.arrayContaining(["ask robots", "ask area"]));
    connection.ask("stop").catch(() => {});
    expect(beats().at(-1)?.what).toBe("ask stop");
  });

  test("without a robot nothing is sent; the first command goes at once, and the rate ends when the robot is free again", () => {
    join();
    vi.advanceTimersByTime(3000);
    expect(beats()).toEqual([]);
    drive(10);
    expect(beats()).toHaveLength(1);
    hear({ kind: "stands", standing: { ...DRIVES, robot: A } });
    vi.advanceTimersByTime(5000);
    expect(beats()).toHaveLength(51);
    hear({ kind: "stands", standing: DRIVES });
    vi.advanceTimersByTime(5000);
    expect(beats().length).toBeLessThan(53);
  });

  test("a page that is put aside says its stop at once: it may never have another slot", () => {
    join({ ...DRIVES, robot: A });
    drive(10);
    connection.hide();
    const before = beats().length;
    drive(0);
    expect(beats().slice(before).map(({ what }) => what)).toEqual(["stop"]);
    connection.wake();
    drive(10);
    vi.advanceTimersByTime(100);
    drive(0);
    connection.leave();
    expect(whats().slice(-2)).toEqual(["stop", "leave"]);
    expect(socket().readyState).toBe(3);
    vi.advanceTimersByTime(60_000);
    expect(FakeSocket.all).toHaveLength(1);
    connection.wake();
    expect(FakeSocket.all).toHaveLength(2);
  });

  test("nothing is commanded before an update was read: it would be late", () => {
    join();
    session().hasSeen = false;
    expect(drive(10)).toBe(false);
  });
});

describe("a broker", () => {
  const AT = { broker: "ws://b:9001/mqtt", root: "/r", mqtt: 5 };
  const sent: string[] = [];
  let ways: Way[] = [];
  const way = () => ways.at(-1) as Way;

  function dial(): Way {
    const made: Way = {
      onOpen: () => {},
      onMessage: () => {},
      onClose: () => {},
      isOpen: true,
      send: (data, topic) => void sent.push(`${topic} ${new TextDecoder().decode(data)}`),
      hear: (topics) => void sent.push(`hear ${topics.join(" ")}`),
      close: () => {},
    };
    ways.push(made);
    return made;
  }

  function beginThere(): void {
    sent.length = 0;
    ways = [];
    connection = new SessionConnection({ url: "", at: AT, fixed: SWARM, invitation: secret("open", 1), name: "Ada" }, store, dial);
  }

  function tell(...events: SessionEvent[]): void {
    session().events.push(...events);
    way().onMessage(new Uint8Array(0));
  }

  test("that is connected already gets the first message at once", () => {
    beginThere();
    expect(sent).toEqual([" hello open 1"]);
  });

  test("gets each message by its topic, and is told which to hear; a reload finds it again", () => {
    beginThere();
    session().isJoined = true;
    tell({ kind: "hear", topics: ["a", "b"] }, { kind: "transmit", data: new Uint8Array([65]), topic: "t" });
    expect(sent.slice(-2)).toEqual(["hear a b", "t A"]);
    tell({ kind: "admitted", visitor: 1, name: "Ada" }, { kind: "keep", secret: secret("resume", 4), lifetime_s: 60 });
    expect(store.find(SWARM, Date.now() / 1000)?.at).toEqual(AT);
    way().onClose("login refused");
    expect(connection.state).toBe("refused");
  });

  test("that does not answer may mean that a secret is void: the other one is tried, and none is thrown away", () => {
    store.keep({ fixed: SWARM, at: AT, secret: secret("resume", 5), name: "Ada", tab: "other" }, 3600, Date.now() / 1000);
    beginThere();
    const tried = [session().secret.kind];
    for (let i = 0; i < 3; i += 1) {
      tell({ kind: "ended", reason: undefined });
      expect(connection.state).toBe("no_answer");
      vi.advanceTimersByTime(5000);
      tried.push(session().secret.kind);
    }
    expect(tried).toEqual(["resume", "open", "resume", "open"]);
    expect(store.find(SWARM, Date.now() / 1000)).toBeDefined();
  });
});
