// Keeps stdout for our JSON lines. It must be imported first: pino, which the package logs with, opens its file
// descriptor when it is loaded.

import { Console } from "node:console";
import { createInterface } from "node:readline";

// pino writes to `process.stdout.fd || 1` itself; our own writes go through the stream's handle, which stays on 1.
Object.defineProperty(process.stdout, "fd", { value: 2 });
globalThis.console = new Console(process.stderr, process.stderr);

export function say(event, fields = {}) {
  process.stdout.write(`${JSON.stringify({ event, ...fields })}\n`);
}

export function lines() {
  return createInterface({ input: process.stdin });
}

export function finish() {
  // A pipe may still hold what we said last; exit() would drop it.
  process.stdout.write("", () => process.exit(0));
}
