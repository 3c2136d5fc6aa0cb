// The link as React hooks.

import { useCallback, useEffect, useRef, useState, useSyncExternalStore } from "react";
import type { Json, JsonObject } from "../core/json";
import type { Pin } from "../core/pin";
import type { Invitation } from "../core/qrurl";
import { SwarmLink, type SwarmSource, type SwarmView } from "../io/swarm_link";
import { NO_SWARM } from "../swarm";

const NOTHING: SwarmView = { swarm: NO_SWARM, health: { state: "connecting", broker: "away" } };

/**
 * A link to the swarm of `to`, for as long as the component lives; another object opens another link.
 *
 * @param to keep its identity while it means the same (useState, useMemo); undefined for no link.
 * @param onMoved told of every new pin.
 */
export function useLink(to: Invitation | undefined, onMoved?: (pin: Pin) => void): SwarmLink | undefined {
  const [link, setLink] = useState<SwarmLink>();
  const moved = useRef(onMoved);
  useEffect(() => {
    moved.current = onMoved;
  });
  useEffect(() => {
    if (!to) return;
    const opened = new SwarmLink(to, (pin) => moved.current?.(pin));
    setLink(opened);
    const wakeIfShown = () => {
      if (document.visibilityState === "visible") opened.wake();
    };
    const wake = () => opened.wake();
    const leave = () => opened.leave();
    document.addEventListener("visibilitychange", wakeIfShown);
    window.addEventListener("online", wake);
    window.addEventListener("pagehide", leave);
    return () => {
      document.removeEventListener("visibilitychange", wakeIfShown);
      window.removeEventListener("online", wake);
      window.removeEventListener("pagehide", leave);
      opened.close();
      setLink(undefined);
    };
  }, [to]);
  return link;
}

/**
 * What `select` takes from the view; renders again only when that changed (by identity).
 *
 * @param select must return a part of the view or a plain value, not a new object.
 */
export function useSwarm<T>(link: SwarmSource | undefined, select: (view: SwarmView) => T): T {
  const subscribe = useCallback((listener: () => void) => link?.subscribe(listener) ?? (() => {}), [link]);
  return useSyncExternalStore(subscribe, () => select(link?.view ?? NOTHING));
}

/** A function that sends one robot a command: false if the broker is away or no robot is named. */
export function useCommand(
  link: SwarmLink | undefined,
  address: string | undefined,
): (name: string, payload: unknown) => boolean {
  return useCallback(
    (name, payload) => link !== undefined && address !== undefined && link.command(address, name, payload),
    [link, address],
  );
}

/** A function that asks, and promises the data of the answer. */
export function useRequest(
  link: SwarmLink | undefined,
): (request: number, more?: JsonObject, timeout_ms?: number) => Promise<Json> {
  return useCallback(
    (request, more, timeout_ms) => link?.request(request, more, timeout_ms) ?? Promise.reject(new Error("no link")),
    [link],
  );
}
