// The page's own steady clock, for what moves between two polls.

import { useEffect, useState } from "react";

/** `performance.now()`, anew every so many milliseconds. */
export function useNow(every_ms: number): number {
  const [now, setNow] = useState(() => performance.now());
  useEffect(() => {
    const timer = window.setInterval(() => setNow(performance.now()), every_ms);
    return () => window.clearInterval(timer);
  }, [every_ms]);
  return now;
}
