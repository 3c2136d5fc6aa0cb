// Node opens AES-GCM and base64url several times faster than JavaScript can, which pages have to (web/client/core/jwe.ts
// says why). Loaded before a program (`node --import`), this gives it native_jwe.mts in that file's place; the rest of the
// library is the pages' own.

import { register } from "node:module";
import { isMainThread } from "node:worker_threads";

// Node loads what it registers once more, in a thread of its own.
if (isMainThread) register(import.meta.url);

export function resolve(specifier, context, next) {
  const inCore = context.parentURL?.includes("/web/client/core/") ?? false;
  return next(inCore && specifier === "./jwe" ? new URL("native_jwe.mts", import.meta.url).href : specifier, context);
}
