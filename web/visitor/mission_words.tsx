// A mission's progress as text: decoded steps, and the state of the chosen robot.

import { type Swarm, type SwarmLink, shortName, useSwarm, type Walk } from "../client";
import { visitor as texts } from "../texts";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
}

export function MissionWords({ link, selected }: Props) {
  // A string: it re-renders only when the text changes, not with every update.
  const words = useSwarm(link, ({ swarm }) => missionWords(swarm, selected));
  const [state, ...lines] = words.split("\n");
  if (state === "none") return null;
  return (
    <section className="panel mission" data-testid="mission" data-state={state} aria-label={texts.mission} aria-live="polite">
      {lines.map((line, i) => (
        <p key={i}>{line}</p>
      ))}
    </section>
  );
}

/** The mission's state (none, waiting, running, stopped, done), then lines to show. */
export function missionWords(swarm: Swarm, selected: string | undefined): string {
  const { missions, robots } = swarm;
  if (!missions) return "none";
  const chosen = selected === undefined ? undefined : robots.get(selected);
  const { progress } = missions;
  if (!progress) return ["waiting", texts.waitForAMission, texts.nobodyDrives].join("\n");
  const walks = [...robots.values()].flatMap(({ walk }) => (walk ? [walk] : []));
  const [state, line] = overall(walks, texts.unlocked(progress.nodes - progress.left, progress.nodes));
  const secret = progress.left === 0 ? texts.unlockedAll : texts.stillSecret(progress.left);
  const last = chosen?.walk ? `${shortName(chosen)}: ${walkWords(chosen.walk)}` : texts.nobodyDrives;
  return [state, line, secret, last].join("\n");
}

function overall(walks: readonly Walk[], count: string): readonly [string, string] {
  const done = walks.filter(({ phase }) => phase === "done").length;
  const over = walks.length > 0 && walks.every(({ phase }) => phase === "done" || phase === "held");
  if (over && done === walks.length) return ["done", texts.missionCompleted(count)];
  if (over) return ["stopped", texts.missionStopped(done, walks.length, count)];
  return ["running", done > 0 ? texts.missionRunsOn(count, done, walks.length) : texts.missionRuns(count)];
}

/** A robot's progress as text. */
export function walkWords({ phase, decoded, of, why }: Walk): string {
  return texts.walks[phase](of > 0 ? `, ${texts.unlocked(decoded, of)}` : "", why === "" ? "" : ` (${why})`);
}
