// The page's monotonic clock, for values that change between two polls.

import { useEffect, useState } from "react";

/** `performance.now()`, updated every `every_ms`. */
export function useNow(every_ms: number): number {
  const [now, setNow] = useState(() => performance.now());
  useEffect(() => {
    const timer = window.setInterval(() => setNow(performance.now()), every_ms);
    return () => window.clearInterval(timer);
  }, [every_ms]);
  return now;
}
