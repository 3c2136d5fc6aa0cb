// A session over a transport that drops, repeats, reorders, reflects, splices, cuts and alters, as tests/test_session_hostile.py
// has it for the client in Python. The server is one handshake of the shared vectors, whose keys are known.

import { readFileSync } from "node:fs";
import { ed25519 } from "@noble/curves/ed25519.js";
import { hmac } from "@noble/hashes/hmac.js";
import { sha256 } from "@noble/hashes/sha2.js";
import { bytesToHex, concatBytes, hexToBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import fc from "fast-check";
import { expect, test } from "vitest";
import { type Kind, Secret, Session, type SessionEvent } from "../client/session";
import { Cipher } from "../client/session/noise";
import { pad } from "../client/session/padding";
import {
  ACCEPT,
  EPOCH,
  RECORD,
  RECORD_HEAD,
  REPLY,
  SECRET,
  SIGNED_UPDATE,
  STANDING,
  UPDATE,
  UPDATE_HEAD,
  WELCOME,
} from "../client/session/records";

const vectors = JSON.parse(readFileSync(`${import.meta.dirname}/../../vectors/session.json`, "utf8")) as {
  readonly handshakes: readonly Readonly<Record<string, string>>[];
};
const shaken = vectors.handshakes[0] as Readonly<Record<string, string>>;
const hex = (word: string): Uint8Array => hexToBytes(shaken[word] ?? "");
const SIGNER = new Uint8Array(32).fill(7);
const CHAIN = new Uint8Array(32).fill(9);
const STATE_BYTES = 16 * 1024;

/** Forged: another visitor's update, who has the key of updates as well. */
type Sort = "reply" | "standing" | "secret" | "update" | "forged";
interface Sent {
  readonly data: Uint8Array;
  /** What a client that opens it reports; undefined: nothing. */
  readonly tells: string | undefined;
}

/** What the server says, each sealed once. */
class Server {
  readonly sent: Sent[] = [];
  readonly #cipher = new Cipher(hex("to_client"));
  readonly #generation = ACCEPT.decode(hex("accept")).generation;
  #chain = CHAIN;
  #records = 0;
  #updates = 0;

  constructor() {
    const topic = new Uint8Array(16);
    this.#seal(WELCOME.encode({ visitor: 1, signer: ed25519.getPublicKey(SIGNER), name: utf8ToBytes("Ada") }), "admitted");
    this.#seal(EPOCH.encode({ epoch: 1, counter: 1, chain: CHAIN, topic }), undefined);
  }

  say(sort: Sort): void {
    const n = this.sent.length;
    const none = { waiting: 0, place: 0, robot: new Uint8Array(0) };
    if (sort === "update" || sort === "forged") this.#update(utf8ToBytes(`state ${n}`), sort === "forged");
    else if (sort === "reply") this.#seal(REPLY.encode({ number: n, payload: Uint8Array.of(n) }), `reply ${n}`);
    else if (sort === "standing") this.#seal(STANDING.encode({ role: 2, left_ms: n, ...none }), `standing ${n}`);
    else this.#seal(SECRET.encode({ secret: new Uint8Array(32).fill(n), lifetime_s: n }), `secret ${n}`);
  }

  #seal(content: Uint8Array, tells: string | undefined): void {
    const head = { generation: this.#generation, counter: this.#records };
    this.#records += 1;
    const sealed = this.#cipher.seal(head.counter, pad(content, STATE_BYTES), RECORD_HEAD.encode(head));
    this.sent.push({ data: RECORD.encode({ ...head, sealed }), tells });
  }

  #update(state: Uint8Array, isForged: boolean): void {
    const head = { epoch: 1, counter: this.#updates + 1 };
    const cipher = new Cipher(hmac(sha256, this.#chain, utf8ToBytes("phalanx/1 update")));
    const sealed = cipher.seal(head.counter, pad(state, STATE_BYTES), UPDATE_HEAD.encode(head));
    const signature = ed25519.sign(SIGNED_UPDATE.encode({ ...head, sealed }), isForged ? CHAIN : SIGNER);
    const tells = isForged ? undefined : `updated ${new TextDecoder().decode(state)}`;
    this.sent.push({ data: UPDATE.encode({ ...head, signature, sealed }), tells });
    if (isForged) return;
    this.#updates += 1;
    this.#chain = hmac(sha256, this.#chain, utf8ToBytes("phalanx/1 chain"));
  }
}

function told(event: SessionEvent): string[] {
  if (event.kind === "replied") return [`reply ${event.number}`];
  if (event.kind === "updated") return [`updated ${new TextDecoder().decode(event.state)}`];
  if (event.kind === "stands") return [`standing ${event.standing.left_ms}`];
  if (event.kind === "keep") return [`secret ${event.lifetime_s}`];
  return event.kind === "transmit" || event.kind === "hear" ? [] : [event.kind];
}

const delivery = fc.record({
  which: fc.nat(),
  how: fc.constantFrom("as it is", "as it is", "as it is", "cut", "altered", "spliced", "longer"),
  other: fc.nat(),
  at: fc.oneof(fc.constantFrom(1, 2, RECORD.size, UPDATE.size - 64, UPDATE.size), fc.nat()),
});
type Delivery = typeof delivery extends fc.Arbitrary<infer T> ? T : never;

function spoiled(all: readonly Uint8Array[], { which, how, other, at }: Delivery): Uint8Array {
  const data = all[which % all.length] as Uint8Array;
  const from = at % data.length;
  if (how === "cut") return data.slice(0, from);
  if (how === "longer") return concatBytes(data, Uint8Array.of(0));
  if (how === "spliced") return concatBytes(data.slice(0, from), (all[other % all.length] as Uint8Array).slice(from));
  return how === "altered" ? data.map((byte, i) => (i === from ? byte ^ (1 << other % 8) : byte)) : data;
}

test("nothing is read twice, out of turn, or that the server did not say; what is refused changes nothing", () => {
  const sorts = fc.array(fc.constantFrom<Sort>("reply", "standing", "secret", "update", "forged"), { minLength: 1, maxLength: 8 });
  fc.assert(
    fc.property(sorts, fc.array(delivery, { maxLength: 40 }), fc.nat(), (said, deliveries, bit) => {
      const secret = new Secret(shaken["kind"] as Kind, hex("secret"));
      const at = { fixed: hex("static"), secret, broker: "", root: "", mqtt: 0 };
      const session = new Session(at, () => hex("client_ephemeral"), "Ada");
      const own: Uint8Array[] = [];
      const carry = (events: readonly SessionEvent[]) => {
        for (const event of events) if (event.kind === "transmit") own.push(event.data);
        return events.flatMap(told);
      };
      carry(session.start(0));
      const accept = hex("accept");
      const forged = accept.map((byte, i) => (i === 2 + (bit % (accept.length - 2)) ? byte ^ 1 : byte));
      expect(carry(session.receive(forged, 0))).toEqual([]);
      carry(session.receive(accept, 0));
      expect(own).toHaveLength(2);

      const server = new Server();
      said.forEach((sort) => server.say(sort));
      const heard: string[] = [];
      const receive = (data: Uint8Array) => {
        const tells = carry(session.receive(data, 0));
        const honest = server.sent.find((each) => bytesToHex(each.data) === bytesToHex(data));
        // A secret may come before `welcome`, and is told with it.
        const most = honest?.tells === "admitted" ? 2 : 1;
        expect(tells.length).toBeLessThanOrEqual(honest?.tells === undefined ? 0 : most);
        heard.push(...tells);
      };
      for (const each of deliveries) receive(spoiled([...server.sent.map(({ data }) => data), ...own], each));
      for (const { data } of server.sent) receive(data);
      for (const sort of ["secret", "update", "reply"] as const) {
        server.say(sort);
        const { data, tells } = server.sent.at(-1) as Sent;
        receive(data);
        expect(heard.at(-1)).toBe(tells);
      }

      expect(session.isJoined).toBe(true);
      expect(new Set(heard).size).toBe(heard.length);
      const all = server.sent.map(({ tells }) => tells);
      expect(heard.filter((each) => !all.includes(each))).toEqual([]);
      expect(all.filter((each) => each?.startsWith("reply") && !heard.includes(each))).toEqual([]);
      for (const sort of ["standing", "secret", "updated"]) {
        const turns = heard.filter((each) => each.startsWith(sort)).map((each) => all.indexOf(each));
        expect(turns).toEqual([...turns].sort((a, b) => a - b));
      }
    }),
    { numRuns: 40 },
  );
});
