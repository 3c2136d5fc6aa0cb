// The swarm's public key, from the page's own origin: for room codes, which are too short to contain one.

import { decodeBase64url } from "../core/base64url";

const KEY_BYTES = 32;
const ANSWER_WITHIN_MS = 5000;

/** Undefined: no answer, or this origin accepts no room codes. */
export async function fetchSwarmKey(href: string): Promise<Uint8Array | undefined> {
  try {
    const answer = await fetch(new URL("link-key", href), {
      cache: "no-store",
      credentials: "omit",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    const key = answer.ok ? decodeBase64url(new TextEncoder().encode((await answer.text()).trim())) : undefined;
    return key?.length === KEY_BYTES ? key : undefined;
  } catch {
    return undefined;
  }
}
