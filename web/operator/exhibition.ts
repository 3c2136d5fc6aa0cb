// "QR only": the code alone, in full screen where the browser allows it, on a screen that does not fall asleep.

import { useCallback, useEffect, useState } from "react";

export interface Exhibition {
  readonly on: boolean;
  readonly enter: () => void;
  readonly leave: () => void;
}

export function useExhibition(): Exhibition {
  const [on, setOn] = useState(false);

  const enter = useCallback(() => {
    setOn(true);
    // Refused in some browsers and frames; the view is the same, in the window.
    document.documentElement.requestFullscreen?.().catch(() => undefined);
  }, []);

  const leave = useCallback(() => {
    setOn(false);
    if (document.fullscreenElement) document.exitFullscreen().catch(() => undefined);
  }, []);

  useEffect(() => {
    if (!on) return;
    const onFullscreen = () => {
      // The browser's own way out (Escape, F11) leaves our view as well.
      if (!document.fullscreenElement) setOn(false);
    };
    const onKey = (event: KeyboardEvent) => {
      if (event.key === "Escape") leave();
    };
    document.addEventListener("fullscreenchange", onFullscreen);
    document.addEventListener("keydown", onKey);
    return () => {
      document.removeEventListener("fullscreenchange", onFullscreen);
      document.removeEventListener("keydown", onKey);
    };
  }, [on, leave]);

  useAwake(on);
  return { on, enter, leave };
}

function useAwake(wanted: boolean): void {
  useEffect(() => {
    if (!wanted || !("wakeLock" in navigator)) return;
    let lock: WakeLockSentinel | undefined;
    let ended = false;
    const hold = async () => {
      try {
        const got = await navigator.wakeLock.request("screen");
        if (ended) await got.release();
        else lock = got;
      } catch {
        // On battery, or forbidden: then the screen sleeps as it always does.
      }
    };
    const onVisible = () => {
      // The browser takes the lock away when the tab is hidden, and does not give it back.
      if (document.visibilityState === "visible") void hold();
    };
    void hold();
    document.addEventListener("visibilitychange", onVisible);
    return () => {
      ended = true;
      document.removeEventListener("visibilitychange", onVisible);
      void lock?.release();
    };
  }, [wanted]);
}
