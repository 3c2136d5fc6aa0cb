// Asks the gateway for its state once a second, and says plainly when it cannot.

import { useEffect, useState } from "react";
import { type GatewayState, NotAState, parseState } from "./gateway_state";
import { dropToken } from "./token";

const EVERY_MS = 1000;
// Longer than any loaded machine needs, and shorter than a person's patience.
const ANSWER_WITHIN_MS = 4000;

export type Trouble = "unreachable" | "incomprehensible";

/** One answer, with when it came on this page's steady clock (milliseconds, `performance.now()`). */
export interface Sample {
  readonly state: GatewayState;
  readonly at_ms: number;
}

export interface Polled {
  /** The newest answer, kept through any trouble that followed. */
  readonly newest: Sample | undefined;
  readonly trouble: Trouble | undefined;
  /** The gateway knows another token: only a new link helps. */
  readonly refused: boolean;
}

const NOTHING: Polled = { newest: undefined, trouble: undefined, refused: false };

/** The gateway's state, asked for with this token; without one, nothing is asked. */
export function useGateway(token: string | undefined): Polled {
  const [polled, setPolled] = useState<Polled>(NOTHING);

  useEffect(() => {
    setPolled(NOTHING);
    if (token === undefined) return;
    let timer: number | undefined;
    let ended = false;

    async function round(): Promise<void> {
      const began_ms = performance.now();
      const outcome = await ask(token as string);
      if (ended) return;
      if (outcome === "refused") {
        dropToken();
        setPolled((before) => ({ ...before, refused: true }));
        return;
      }
      setPolled((before) =>
        typeof outcome === "string"
          ? { ...before, trouble: outcome }
          : { newest: outcome, trouble: undefined, refused: false },
      );
      timer = window.setTimeout(round, Math.max(0, began_ms + EVERY_MS - performance.now()));
    }

    void round();
    return () => {
      ended = true;
      window.clearTimeout(timer);
    };
  }, [token]);

  return polled;
}

async function ask(token: string): Promise<Sample | Trouble | "refused"> {
  try {
    const answer = await fetch("/api/state", {
      headers: { Authorization: `Bearer ${token}` },
      cache: "no-store",
      credentials: "omit",
      // The token is for the gateway alone.
      redirect: "error",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    if (answer.status === 401 || answer.status === 403) return "refused";
    if (!answer.ok) return "unreachable";
    return { state: parseState(await answer.json()), at_ms: performance.now() };
  } catch (error) {
    return error instanceof NotAState || error instanceof SyntaxError ? "incomprehensible" : "unreachable";
  }
}
