// A visitor without a page, for interoperability tests: JSON lines in, JSON lines out.
//
//   npx tsx tests/peer.ts '<qr url>' [root]
//
// In:  {"do":"command","address":…,"application":"0","name":…,"payload":…}
//      {"do":"request","request":0,"id":1,"more":{"frames":true},"timeout_ms":3000}   (more, timeout_ms: as needed)
//      {"do":"quit"}; so does the end of the input.
// Out: {"event":"ready","client_id":…} at every connection, {"event":"offline"}, {"event":"notify","payload":…},
//      {"event":"reply","id":1,"data":…}, {"event":"moved"}, {"event":"rejected","reason":…[,"skew_s":…]},
//      {"event":"error","message":…[,"id":…]}. Nothing else is written to stdout, and never a pin.

import { createInterface } from "node:readline";
import { type JsonObject, parseQrUrl } from "../client";
import { Connection } from "../client/io/connection";

interface Order {
  readonly do?: string;
  readonly address?: string;
  readonly application?: string;
  readonly name?: string;
  readonly payload?: unknown;
  readonly request?: number;
  readonly id?: unknown;
  readonly more?: JsonObject;
  readonly timeout_ms?: number;
}

function say(words: object): void {
  process.stdout.write(`${JSON.stringify(words)}\n`);
}

function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

function obey(connection: Connection, order: Order): void {
  switch (order.do) {
    case "command": {
      const { address = "", application = "0", name = "", payload = null } = order;
      if (!connection.command(address, application, name, payload)) throw new Error("the broker is away");
      return;
    }
    case "request": {
      const { request = 0, id = null, more = {}, timeout_ms } = order;
      connection.request(request, more, timeout_ms).then(
        (data) => say({ event: "reply", id, data }),
        (error: unknown) => say({ event: "error", id, message: messageOf(error) }),
      );
      return;
    }
    default:
      throw new Error(`do is ${JSON.stringify(order.do)}, and must be command, request or quit`);
  }
}

function main(url: string, root: string | undefined): void {
  const connection = new Connection(parseQrUrl(url, root));
  connection.listen((event) => {
    switch (event.kind) {
      case "broker":
        say(event.state === "online" ? { event: "ready", client_id: connection.clientId } : { event: event.state });
        return;
      case "notified":
        say({ event: "notify", payload: event.payload });
        return;
      case "moved":
        say({ event: "moved" });
        return;
      case "rejected": {
        const { reason, skew_s } = event;
        say({ event: "rejected", reason, ...(skew_s !== undefined && { skew_s }) });
      }
    }
  });

  const lines = createInterface({ input: process.stdin });
  lines.on("line", (line) => {
    if (line.trim() === "") return;
    try {
      const order = JSON.parse(line) as Order;
      if (order.do === "quit") lines.close();
      else obey(connection, order);
    } catch (error) {
      say({ event: "error", message: messageOf(error) });
    }
  });
  lines.on("close", () => {
    connection.close();
    // An input that its writer keeps open would keep us alive.
    process.stdin.destroy();
  });
}

const [url, root] = process.argv.slice(2);
try {
  if (url === undefined) throw new Error("usage: npx tsx tests/peer.ts '<qr url>' [root]");
  main(url, root);
} catch (error) {
  say({ event: "error", message: messageOf(error) });
  process.exitCode = 2;
}
