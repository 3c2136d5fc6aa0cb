// Announcements about this visitor's robots: arrived, or stopped.

import { useEffect, useState } from "react";
import { type Point, type Swarm, type SwarmLink, shortName } from "../client";
import { visitor as texts } from "../texts";
import { buzz } from "./buzz";

const SAID_FOR_MS = 6000;
/** A robot rolls on a little after it has arrived. */
const ROLLS_ON = 1.5;

/** The newest announcement, for a while; otherwise "". `mine`: ends of routes that this page sent and robots still follow. */
export function useNews(link: SwarmLink | undefined, selected: string | undefined, mine: Map<string, Point>): string {
  const [news, setNews] = useState("");

  useEffect(() => {
    if (!link) return;
    let before = link.view.swarm;
    return link.subscribe(() => {
      const now = link.view.swarm;
      if (now === before) return;
      for (const address of new Set([...mine.keys(), selected ?? ""])) {
        const said = newsOf(before, now, address, mine.get(address));
        if (said === undefined) continue;
        mine.delete(address);
        setNews(said);
        buzz(120, 80, 120);
      }
      before = now;
    });
  }, [link, selected, mine]);

  useEffect(() => {
    // Repeating the same text is no change, and would not be read out.
    const timer = setTimeout(() => setNews(""), SAID_FOR_MS);
    return () => clearTimeout(timer);
  }, [news]);

  return news;
}

/** What happened to a robot between two states, if worth announcing. `end`: end of the route sent to it. */
export function newsOf(before: Swarm, now: Swarm, address: string, end?: Point): string | undefined {
  const [was, is] = [before.robots.get(address), now.robots.get(address)];
  if (!was || !is) return undefined;
  if (is.shield?.safeMode && was.shield?.safeMode === false) return texts.wasStopped(shortName(is));
  // A robot that nobody drives follows its own routes: only the end of the sent one counts.
  const isNear = (point?: Point) =>
    point && end && Math.hypot(point.x - end.x, point.y - end.y) <= ROLLS_ON * was.threshold;
  const hasArrived = isNear(was.waypoints.at(-1)) && !isNear(is.waypoints.at(-1)) && isNear(is.position);
  return hasArrived ? texts.hasArrived(shortName(is)) : undefined;
}
