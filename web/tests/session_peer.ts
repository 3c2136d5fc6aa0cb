// A session without a page or a socket, for tests against the server in Python: JSON lines in, JSON lines out.
//
//   npx tsx tests/session_peer.ts <seed>
//
// In:  {"do":"new","id":1,"static":…,"kind":"open","secret":…,"broker":…,"root":…,"mqtt":5,"name":…}, {"do":"start","id":1,"now":…},
//      {"do":"receive","id":1,"data":…,"now":…}, {"do":"tick",…}, {"do":"command","robot":…,"name":…,"payload":…,"stop":false,…},
//      {"do":"request",…}, {"do":"stored",…}, {"do":"leave",…}. Bytes are hex.
// Out: one line for each: {"events":[…],"rejected":{…},"over":false}, or {"error":…}.

import { createInterface } from "node:readline";
import { sha256 } from "@noble/hashes/sha2.js";
import { bytesToHex, concatBytes, hexToBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import { type Kind, Secret, Session, type SessionEvent } from "../client/session";

interface Order {
  readonly do: string;
  readonly id: number;
  readonly now: number;
  readonly [word: string]: string | number | boolean;
}

const sessions = new Map<number, Session>();
const kept = new Map<number, Secret>();

/** Bytes that look random, and are the same in every run. */
function randomSource(seed: string): (length: number) => Uint8Array {
  let count = 0;
  return (length) => {
    let made = new Uint8Array(0);
    while (made.length < length) {
      count += 1;
      made = concatBytes(made, sha256(utf8ToBytes(`${seed} ${count}`)));
    }
    return made.slice(0, length);
  };
}

function text(order: Order, word: string): string {
  return String(order[word] ?? "");
}

function obey(order: Order): SessionEvent[] {
  const { id, now } = order;
  if (order.do === "new") {
    const secret = new Secret(text(order, "kind") as Kind, hexToBytes(text(order, "secret")));
    const [broker, root, mqtt] = [text(order, "broker"), text(order, "root"), Number(order["mqtt"] ?? 0)];
    const invitation = { fixed: hexToBytes(text(order, "static")), secret, broker, root, mqtt };
    sessions.set(id, new Session(invitation, randomSource(`${process.argv[2] ?? ""} ${id}`), text(order, "name")));
    return [];
  }
  const session = sessions.get(id);
  if (session === undefined) throw new Error(`no session ${id}`);
  switch (order.do) {
    case "start":
      return session.start(now);
    case "receive":
      return session.receive(hexToBytes(text(order, "data")), now);
    case "tick":
      return session.tick(now);
    case "leave":
      return session.leave(now);
    case "stored": {
      const secret = kept.get(id);
      return secret ? [session.stored(secret, now)] : [];
    }
    case "command": {
      const payload = hexToBytes(text(order, "payload"));
      return [session.command(text(order, "robot"), text(order, "name"), payload, now, order["stop"] === true)];
    }
    case "request":
      return [session.request(text(order, "name"), hexToBytes(text(order, "payload")), now).event];
    default:
      throw new Error(`do is ${order.do}`);
  }
}

function shown(id: number, event: SessionEvent): object {
  if (event.kind === "keep") kept.set(id, event.secret);
  const entries = Object.entries(event).map(([key, value]: [string, unknown]) => {
    if (value instanceof Uint8Array) return [key, bytesToHex(value)];
    return [key, value instanceof Secret ? bytesToHex(value.reveal()) : value];
  });
  return Object.fromEntries(entries) as object;
}

createInterface({ input: process.stdin }).on("line", (line) => {
  const order = JSON.parse(line) as Order;
  let answer: object;
  try {
    const events = obey(order).map((event) => shown(order.id, event));
    const session = sessions.get(order.id);
    answer = { events, rejected: Object.fromEntries(session?.rejected ?? []), over: session?.isOver };
  } catch (error) {
    answer = { error: error instanceof Error ? `${error.name}: ${error.message}` : String(error) };
  }
  process.stdout.write(`${JSON.stringify(answer)}\n`);
});
