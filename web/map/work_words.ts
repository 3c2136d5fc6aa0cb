// The score of a swarm's task, as a line on the map.

import type { Work } from "../client";
import { common as texts } from "../texts";

const MINUTE_S = 60;

export function workWords({ name, score, counts, lately_s }: Work): string {
  const work = texts.works[name] ?? name;
  if (score === undefined) return texts.nothingToCount(work);
  const space = counts.startsWith("%") ? "\u202f" : " ";
  const lately = lately_s >= 2 * MINUTE_S ? texts.minutes(Math.round(lately_s / MINUTE_S)) : texts.seconds(Math.round(lately_s));
  return texts.score(work, `${Math.round(score)}${space}${texts.counted[counts] ?? counts}`, lately);
}
