// What is said aloud of the robots that this visitor cares for: that one arrived, that one was stopped.

import { useEffect, useState } from "react";
import { type Swarm, type SwarmLink, shortName } from "../client";
import { visitor as texts } from "../texts";
import { buzz } from "./buzz";

const SAID_FOR_MS = 6000;
/** A robot rolls on a little after it has arrived. */
const ROLLS_ON = 1.5;

/** The newest of it, for a while; else "". `mine` keeps its identity. */
export function useNews(link: SwarmLink | undefined, selected: string | undefined, mine: ReadonlySet<string>): string {
  const [news, setNews] = useState("");

  useEffect(() => {
    if (!link) return;
    let before = link.view.swarm;
    return link.subscribe(() => {
      const now = link.view.swarm;
      if (now === before) return;
      for (const address of new Set([...mine, ...(selected === undefined ? [] : [selected])])) {
        const said = newsOf(before, now, address);
        if (said === undefined) continue;
        setNews(said);
        buzz(120, 80, 120);
      }
      before = now;
    });
  }, [link, selected, mine]);

  useEffect(() => {
    // The same words said again are no change, and would not be read out.
    const timer = setTimeout(() => setNews(""), SAID_FOR_MS);
    return () => clearTimeout(timer);
  }, [news]);

  return news;
}

/** What happened to a robot between two states of the swarm, if it is worth saying. */
export function newsOf(before: Swarm, now: Swarm, address: string): string | undefined {
  const [was, is] = [before.robots.get(address), now.robots.get(address)];
  if (!was || !is) return undefined;
  if (is.shield?.safeMode && was.shield?.safeMode === false) return texts.wasStopped(shortName(is));
  const end = was.waypoints.at(-1);
  if (!end || is.waypoints.length > 0 || !is.position) return undefined;
  const reach = ROLLS_ON * was.threshold;
  const left = Math.hypot(is.position.x - end.x, is.position.y - end.y);
  return left <= reach ? texts.hasArrived(shortName(is)) : undefined;
}
