// Poll the gateway's state once a second, and report when it does not answer.

import { useEffect, useState } from "react";
import { Refused } from "../client";
import { type GatewayState, NotAState, parseState } from "./gateway_state";
import type { Station } from "./station";

const EVERY_MS = 1000;
// Longer than a busy machine needs, and shorter than a person's patience.
const ANSWER_WITHIN_MS = 4000;
/** A session needs a moment to start. */
const BEGINS_WITHIN_MS = 3000;
const BEGINS_EVERY_MS = 100;

export type Trouble = "unreachable" | "incomprehensible";

/** An answer, with its arrival time on this page's monotonic clock (milliseconds, `performance.now()`). */
export interface Sample {
  readonly state: GatewayState;
  readonly at_ms: number;
}

export interface Polled {
  /** The newest answer, also kept during later errors. */
  readonly newest: Sample | undefined;
  readonly trouble: Trouble | undefined;
}

const NOTHING: Polled = { newest: undefined, trouble: undefined };

/** The gateway's state, polled through a station. */
export function useGateway(station: Station): Polled {
  const [polled, setPolled] = useState<Polled>(NOTHING);

  useEffect(() => {
    let timer: number | undefined;
    let ended = false;

    const opened_ms = performance.now();
    let isBegun = false;

    async function round(): Promise<void> {
      const began_ms = performance.now();
      const outcome = await ask(station);
      if (ended) return;
      isBegun ||= outcome !== "unreachable" || performance.now() - opened_ms > BEGINS_WITHIN_MS;
      if (isBegun) {
        setPolled((before) =>
          typeof outcome === "string" ? { ...before, trouble: outcome } : { newest: outcome, trouble: undefined },
        );
      }
      const every_ms = isBegun ? EVERY_MS : BEGINS_EVERY_MS;
      timer = window.setTimeout(round, Math.max(0, began_ms + every_ms - performance.now()));
    }

    void round();
    return () => {
      ended = true;
      window.clearTimeout(timer);
    };
  }, [station]);

  return polled;
}

async function ask(station: Station): Promise<Sample | Trouble> {
  try {
    return { state: parseState(await station.ask("state", {}, ANSWER_WITHIN_MS)), at_ms: performance.now() };
  } catch (error) {
    return error instanceof NotAState || (error instanceof Refused && error.reason === "unknown")
      ? "incomprehensible"
      : "unreachable";
  }
}
