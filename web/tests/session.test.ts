// The shared vectors of sessions, and the published ones of the handshake: the same cases decide what Python and this
// client send, accept and refuse.

import { readFileSync } from "node:fs";
import { bytesToHex, hexToBytes } from "@noble/hashes/utils.js";
import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { decodeMessage } from "../client/session/messages";
import { fragmentOf, type Invitation, parseInvitation, parseRoomCode } from "../client/session/invitation";
import { Cipher, Initiator } from "../client/session/noise";
import { pad, unpad } from "../client/session/padding";
import { COMMAND, type EpochFields, JOIN, LEAVE, LINK_REQUEST, STORED } from "../client/session/records";
import { helloTopic, type Kind, prologue, recordTopic, Secret } from "../client/session/secret";
import { Session } from "../client/session/session";
import { UpdateReader } from "../client/session/updates";
import { Window } from "../client/session/window";

interface Case {
  readonly name: string;
  readonly expect: string;
}
type Words = Case & Readonly<Record<string, string>>;
type Fields = Readonly<Record<string, string | number | boolean>>;

interface Steps {
  readonly name: string;
  readonly steps: readonly (Words & { counter: number; epoch: number })[];
}

interface Vectors {
  readonly signer: string;
  readonly secrets: readonly Words[];
  readonly invitations: readonly (Words & { mqtt: number })[];
  readonly padding: readonly Words[];
  readonly window: readonly Steps[];
  readonly handshakes: readonly (Words & { mqtt: number; reply_number: number })[];
  readonly messages: readonly (Case & { from: string; kind: string; content: string; fields: Fields })[];
  readonly updates: readonly Steps[];
}

function load(file: string): unknown {
  return JSON.parse(readFileSync(`${import.meta.dirname}/../../vectors/${file}.json`, "utf8"));
}

const vectors = load("session") as Vectors;
const hex = (text: string | undefined): Uint8Array => hexToBytes(text ?? "");

function outcome<T>(run: () => T): { name: string; result?: T } {
  try {
    return { name: "ok", result: run() };
  } catch (error) {
    return { name: (error as Error).name };
  }
}

function secretOf(kind: string | undefined, raw: string | undefined): Secret {
  return new Secret(kind as Kind, hex(raw));
}

describe("the published vectors of the handshake", () => {
  interface Published {
    readonly name: string;
    readonly init_prologue: string;
    readonly init_psks: readonly string[];
    readonly init_ephemeral: string;
    readonly init_remote_static: string;
    readonly handshake_hash: string;
    readonly messages: readonly { payload: string; ciphertext: string }[];
  }
  const { cases } = load("noise") as { cases: readonly Published[] };

  test.each(cases)("$name", (c) => {
    const psk = hex(c.init_psks[0]);
    const initiator = new Initiator(hex(c.init_prologue), hex(c.init_remote_static), psk, hex(c.init_ephemeral));
    const [first, second, ...rest] = c.messages;
    expect(bytesToHex(initiator.write(hex(first?.payload)))).toBe(first?.ciphertext);
    expect(outcome(() => initiator.read(new Uint8Array(48))).name).toBe("NotAuthentic");
    const { payload, keys } = initiator.read(hex(second?.ciphertext));
    expect(bytesToHex(payload)).toBe(second?.payload);
    expect(bytesToHex(keys.handshakeHash)).toBe(c.handshake_hash);
    expect(rest.length).toBe(4);
    rest.forEach((message, i) => {
      const cipher = i % 2 === 0 ? keys.toServer : keys.toClient;
      const counter = Math.floor(i / 2);
      expect(bytesToHex(cipher.seal(counter, hex(message.payload), hex("")))).toBe(message.ciphertext);
      expect(bytesToHex(cipher.open(counter, hex(message.ciphertext), hex("")))).toBe(message.payload);
    });
  });

  test.each(["00".repeat(32), `01${"00".repeat(31)}`, `ec${"ff".repeat(30)}7f`])("a key of low order: %s", (low) => {
    const initiator = new Initiator(hex(""), hex(low), new Uint8Array(32), new Uint8Array(32).fill(1));
    expect(outcome(() => initiator.write()).name).toBe("NotAuthentic");
  });
});

describe("secrets", () => {
  test.each(vectors.secrets)("$name", (c) => {
    const secret = secretOf(c.kind, c["raw"]);
    const hello = hex(c["hello"]);
    const made = [bytesToHex(secret.psk), bytesToHex(secret.id), bytesToHex(secret.mac1(hello)), secret.acceptTopic(hello)];
    expect(made).toEqual([c["psk"], c["id"], c["mac1"], c["accept_topic"]]);
  });

  test("printing one shows nothing", () => {
    const secret = new Secret("open", new Uint8Array(16).fill(0x5a));
    for (const shown of [String(secret), JSON.stringify({ secret }), JSON.stringify(Object.entries(secret))]) {
      expect(shown).not.toMatch(/90|5a|Z/);
    }
    for (const shown of [String(secret), JSON.stringify(secret)]) {
      expect(shown).toContain("<Secret>");
    }
  });
});

describe("invitations", () => {
  test.each(vectors.invitations)("$name", (c) => {
    const { name, result } = outcome(() => parseInvitation(`http://10.0.0.7/#${c["fragment"] ?? ""}`));
    expect(name).toBe(c.expect);
    if (!result) return;
    expect(bytesToHex(result.fixed)).toBe(c["static"]);
    expect(bytesToHex(result.secret.reveal())).toBe(c["secret"]);
    expect([result.secret.kind, result.broker, result.root, result.mqtt]).toEqual([c["kind"], c["broker"], c["root"], c.mqtt]);
    expect(fragmentOf(result)).toBe(c["fragment"]);
  });

  test("a room code is eight digits as people type them", () => {
    for (const typed of ["1234 5678", "12345678", " 1234-5678\n"]) {
      expect(new TextDecoder().decode(parseRoomCode(typed).reveal())).toBe("12345678");
    }
    for (const typed of ["", "1234 567", "1234 56789", "1234567a"]) {
      expect(outcome(() => parseRoomCode(typed)).name).toBe("BadInvitation");
    }
  });
});

describe("padding", () => {
  test.each(vectors.padding)("$name", (c) => {
    const { name, result } = outcome(() => unpad(hex(c["plaintext"])));
    expect(name).toBe(c.expect);
    if (!result) return;
    expect(bytesToHex(result)).toBe(c["content"]);
    expect(bytesToHex(pad(result, 1 << 20))).toBe(c["plaintext"]);
  });
});

describe("window", () => {
  test.each(vectors.window)("$name", (c) => {
    const window = new Window();
    for (const { counter, expect: expected } of c.steps) {
      expect(outcome(() => window.check(counter)).name).toBe(expected);
      if (expected === "ok") window.enter(counter);
    }
  });

  test("no counter passes twice", () => {
    fc.assert(
      fc.property(fc.array(fc.nat(3000), { maxLength: 200 }), (counters) => {
        const window = new Window();
        const passed = new Set<number>();
        for (const counter of counters) {
          const newest = Math.max(-1, ...passed);
          const { name } = outcome(() => window.check(counter));
          expect(name === "ok").toBe(!passed.has(counter) && counter > newest - 1024);
          if (name !== "ok") continue;
          window.enter(counter);
          passed.add(counter);
        }
      }),
    );
  });
});

describe("handshakes", () => {
  function invited(c: Words & { mqtt: number }): Invitation {
    const secret = secretOf(c["kind"], c["secret"]);
    return { fixed: hex(c["static"]), secret, broker: c["broker"] ?? "", root: c["root"] ?? "", mqtt: c.mqtt };
  }

  test.each(vectors.handshakes)("$name", (c) => {
    const invitation = invited(c);
    expect(bytesToHex(prologue(invitation.secret, invitation.root, invitation.broker))).toBe(c["prologue"]);
    const session = new Session(invitation, () => hex(c["client_ephemeral"]), c["nickname"]);
    const hello = session.start(0).at(-1);
    expect(hello).toMatchObject({ kind: "transmit", topic: c["broker"] ? c["hello_topic"] : "" });
    if (hello?.kind === "transmit") expect(bytesToHex(hello.data)).toBe(c["hello"]);
    const events = session.receive(hex(c["accept"]), 1);
    const record = events.at(-1);
    if (record?.kind !== "transmit") throw new Error("no first record");
    expect(bytesToHex(record.data)).toBe(c["first_record"]);
    const topics = [c["to_server"], c["to_client"]].map((key) => recordTopic(new Cipher(hex(key))));
    expect(topics).toEqual([c["topic_to_server"], c["topic_to_client"]]);
    expect(helloTopic(invitation.fixed)).toBe(c["hello_topic"]);
    if (c["broker"]) {
      expect(record.topic).toBe(c["topic_to_server"]);
      expect(events[0]).toEqual({ kind: "hear", topics: [c["topic_to_client"]] });
    }
    const reply = { kind: "replied", number: c.reply_number, payload: hex(c["reply"]) };
    expect(session.receive(hex(c["reply_record"]), 2)).toEqual([reply]);
    expect(session.receive(hex(c["reply_record"]), 2)).toEqual([]);
    expect([...session.rejected]).toEqual([["replayed", 1]]);
  });

  test("whatever comes, a session returns", () => {
    const c = vectors.handshakes[0];
    if (c === undefined) throw new Error("no vector");
    fc.assert(
      fc.property(fc.array(fc.uint8Array({ maxLength: 120 }), { maxLength: 8 }), fc.boolean(), (garbage, accepted) => {
        const session = new Session(invited(c), () => hex(c["client_ephemeral"]));
        session.start(0);
        if (accepted) session.receive(hex(c["accept"]), 1);
        const before = [...session.rejected.values()].reduce((sum, n) => sum + n, 0);
        for (const raw of garbage) expect(session.receive(raw, 2)).toEqual([]);
        expect([...session.rejected.values()].reduce((sum, n) => sum + n, 0) - before).toBe(garbage.length);
        expect(session.isOver).toBe(false);
        if (!accepted) expect(session.receive(hex(c["accept"]), 3)).toHaveLength(1);
        expect(session.receive(hex(c["reply_record"]), 4)).toHaveLength(1);
      }),
    );
  });

  test("without an answer, or without a welcome, it ends after five seconds", () => {
    const c = vectors.handshakes[0];
    if (c === undefined) throw new Error("no vector");
    for (const accepted of [false, true]) {
      const session = new Session(invited(c), () => hex(c["client_ephemeral"]));
      session.start(0);
      if (accepted) session.receive(hex(c["accept"]), 0);
      expect(session.tick(4999)).toEqual([]);
      expect(outcome(() => session.command("R1", "move_raw", hex(""), 0)).name).toBe("UsageError");
      expect(session.tick(5000)).toEqual([{ kind: "ended", reason: undefined }]);
      expect(session.receive(hex(c["accept"]), 5001)).toEqual([]);
    }
  });
});

describe("messages", () => {
  const plain = (value: unknown): unknown => {
    if (value instanceof Uint8Array) return bytesToHex(value);
    return value instanceof Secret ? bytesToHex(value.reveal()) : value;
  };

  test.each(vectors.messages.filter((c) => c.from === "server"))("read: $name", (c) => {
    const { name, result } = outcome(() => decodeMessage(hex(c.content)));
    expect(name).toBe(c.expect);
    if (!result) return;
    expect(result.kind).toBe(c.kind);
    const fields = result.kind === "epoch" ? result.epoch : result.kind === "standing" ? result.standing : result;
    const entries = Object.entries(fields).filter(([key]) => key !== "kind");
    expect(Object.fromEntries(entries.map(([key, value]) => [key, plain(value)]))).toEqual(c.fields);
  });

  const ours = vectors.messages.filter((c) => c.from === "client" && c.expect === "ok" && Object.keys(c.fields).length > 0);
  test.each(ours)("written: $name", ({ kind, fields, content }) => {
    const utf8 = new TextEncoder();
    const texts = new Set(["name", "robot"]);
    const values: Readonly<Record<string, unknown>> = Object.fromEntries(
      Object.entries(fields).map(([key, value]): [string, unknown] => {
        if (typeof value !== "string") return [key, Number(value)];
        return [key, texts.has(key) ? utf8.encode(value) : hexToBytes(value)];
      }),
    );
    const layouts = { join: JOIN, stored: STORED, command: COMMAND, request: LINK_REQUEST, leave: LEAVE } as Record<string, unknown>;
    const layout = layouts[kind] as { encode(values: unknown): Uint8Array };
    expect(bytesToHex(layout.encode(values))).toBe(content);
  });
});

describe("updates", () => {
  test.each(vectors.updates)("$name", (c) => {
    const reader = new UpdateReader(hex(vectors.signer));
    for (const step of c.steps) {
      if (step["do"] === "learn") {
        const { epoch, counter } = step;
        const fields: EpochFields = { epoch, counter, chain: hex(step["chain"]), topic: hex(step["topic"]) };
        reader.learn(fields);
        continue;
      }
      const before = reader.seen;
      const { name, result } = outcome(() => reader.open(hex(step["update"])));
      expect(name).toBe(step.expect);
      if (!result) expect(reader.seen).toBe(before);
      else expect([bytesToHex(result), bytesToHex(reader.digest)]).toEqual([step["state"], step["digest"]]);
    }
  });
});
