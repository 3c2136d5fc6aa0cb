// The link as React hooks.

import { useCallback, useEffect, useState, useSyncExternalStore } from "react";
import type { Json } from "../core/json";
import { SwarmLink, type SwarmSource, type SwarmView } from "../io/swarm_link";
import type { Transport } from "../io/transport";
import { NO_SWARM } from "../swarm";
import { NO_VISIT } from "../visit";

const NOTHING: SwarmView = { swarm: NO_SWARM, health: { state: "connecting", broker: "away" }, visit: NO_VISIT };

const OPEN_AGAIN_MS = 2000;

/**
 * A link over the transport that `open` makes, while the component is mounted; another function opens another link.
 *
 * @param open keep its identity while it means the same (useState, useMemo); undefined for no link.
 */
export function useLink<T extends Transport>(open: (() => T | Promise<T>) | undefined): SwarmLink<T> | undefined {
  const [transport, setTransport] = useState<T>();
  useEffect(() => {
    if (!open) return;
    let isOver = false;
    let again: ReturnType<typeof setTimeout> | undefined;
    const tryOpening = () => {
      Promise.resolve(open()).then(
        (opened) => (isOver ? opened.close() : setTransport(() => opened)),
        // A lazily loaded part of the page could not be loaded.
        () => {
          if (!isOver) again = setTimeout(tryOpening, OPEN_AGAIN_MS);
        },
      );
    };
    tryOpening();
    return () => {
      isOver = true;
      clearTimeout(again);
      setTransport(undefined);
    };
  }, [open]);
  return useSwarmLink(transport);
}

function useSwarmLink<T extends Transport>(transport: T | undefined): SwarmLink<T> | undefined {
  const [link, setLink] = useState<SwarmLink<T>>();
  useEffect(() => {
    if (!transport) return;
    const opened = new SwarmLink(transport);
    setLink(opened);
    const follow = () => (document.visibilityState === "visible" ? opened.wake() : opened.hide());
    const wake = () => opened.wake();
    const leave = () => opened.leave();
    document.addEventListener("visibilitychange", follow);
    window.addEventListener("online", wake);
    window.addEventListener("pagehide", leave);
    return () => {
      document.removeEventListener("visibilitychange", follow);
      window.removeEventListener("online", wake);
      window.removeEventListener("pagehide", leave);
      opened.close();
      setLink(undefined);
    };
  }, [transport]);
  return link;
}

/**
 * The part of the view that `select` returns; re-renders only when it changes (by identity).
 *
 * @param select must return a part of the view or a plain value, not a new object.
 */
export function useSwarm<T>(link: SwarmSource | undefined, select: (view: SwarmView) => T): T {
  const subscribe = useCallback((listener: () => void) => link?.subscribe(listener) ?? (() => {}), [link]);
  return useSyncExternalStore(subscribe, () => select(link?.view ?? NOTHING));
}

/** Return a function that sends one robot a command; it returns false if disconnected or without a robot. */
export function useCommand(
  link: SwarmLink | undefined,
  address: string | undefined,
): (name: string, payload: unknown) => boolean {
  return useCallback(
    (name, payload) => link !== undefined && address !== undefined && link.command(address, name, payload),
    [link, address],
  );
}

/** Return a function that sends a request, and promises the data of the answer. */
export function useRequest(
  link: SwarmLink | undefined,
): (request: number, timeout_ms?: number) => Promise<Json> {
  return useCallback(
    (request, timeout_ms) => link?.request(request, timeout_ms) ?? Promise.reject(new Error("no link")),
    [link],
  );
}
