// Rates of the gateway's counters, from successive polls.

import { useEffect, useState } from "react";
import type { GatewayState } from "./gateway_state";
import type { Sample } from "./poll";

// Short enough to show that a visitor starts to drive, long enough to hide a missed poll.
const WINDOW_MS = 10_000;

export type Totals = Readonly<Record<string, number>>;

export interface TotalsAt {
  readonly at_ms: number;
  readonly uptime_s: number;
  readonly totals: Totals;
}

/** Counters by name, refusals by reason; the two sets of keys are disjoint. */
export function totalsOf(state: GatewayState): Totals {
  return { ...state.counters, ...state.rejected };
}

/** The samples of the window, newest last. A restarted gateway starts a new window. */
export function extend(window: readonly TotalsAt[], next: TotalsAt): readonly TotalsAt[] {
  const last = window.at(-1);
  if (last && next.uptime_s < last.uptime_s) return [next];
  return [...window.filter((sample) => next.at_ms - sample.at_ms <= WINDOW_MS), next];
}

/** Per second, over the window; undefined until there are two samples. */
export function rate(window: readonly TotalsAt[], name: string): number | undefined {
  const first = window[0];
  const last = window.at(-1);
  if (!first || !last || last.at_ms <= first.at_ms) return undefined;
  // A reason absent from the first sample had no refusals then.
  const grown = (last.totals[name] ?? 0) - (first.totals[name] ?? 0);
  return Math.max(0, grown) / ((last.at_ms - first.at_ms) / 1000);
}

/** The window that ends at the newest sample. */
export function useWindow(newest: Sample | undefined): readonly TotalsAt[] {
  const [window, setWindow] = useState<readonly TotalsAt[]>([]);
  useEffect(() => {
    if (!newest) return;
    const { state, at_ms } = newest;
    setWindow((before) => extend(before, { at_ms, uptime_s: state.uptime_s, totals: totalsOf(state) }));
  }, [newest]);
  return window;
}
