// "QR only": the code alone, full screen if the browser allows it, while the screen is kept awake.

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
    // Some browsers and frames refuse; the view is then shown in the window.
    document.documentElement.requestFullscreen?.().catch(() => undefined);
  }, []);

  const leave = useCallback(() => {
    setOn(false);
    if (document.fullscreenElement) document.exitFullscreen().catch(() => undefined);
  }, []);

  useEffect(() => {
    if (!on) return;
    const onFullscreen = () => {
      // Leaving full screen by the browser (Escape, F11) also closes our view.
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
        // On battery, or forbidden: the screen then sleeps as usual.
      }
    };
    const onVisible = () => {
      // The browser releases the lock when the tab is hidden, and does not restore it.
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
