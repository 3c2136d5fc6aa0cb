// A mission in words: how much is decoded, and how far the chosen robot is.

import { driftWords, type Swarm, type SwarmLink, shortName, useSwarm, type Walk } from "../client";

// The line from which on it is about the robot's wheels.
const LEARNT = 3;

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
}

export function MissionWords({ link, selected }: Props) {
  // A string: it renders again only when the words change, not at every frame.
  const words = useSwarm(link, ({ swarm }) => missionWords(swarm, selected));
  const [state, ...lines] = words.split("\n");
  if (state === "none") return null;
  return (
    <section className="panel mission" data-testid="mission" data-state={state} aria-label="Mission" aria-live="polite">
      {lines.map((line, i) => (
        // What a robot learns changes every second: nobody wants that read aloud.
        <p key={i} aria-live={i >= LEARNT ? "off" : undefined}>
          {line}
        </p>
      ))}
    </section>
  );
}

/** The mission's state (none, waiting, running, stopped, done), then lines to show. */
export function missionWords(swarm: Swarm, selected: string | undefined): string {
  const { missions, robots } = swarm;
  if (!missions) return "none";
  const chosen = selected === undefined ? undefined : robots.get(selected);
  const driven = "Nobody drives robots on a mission: each goes where what it finds tells it.";
  const { progress } = missions;
  if (!progress) return ["waiting", "The robots wait for a mission.", driven].join("\n");
  const walks = [...robots.values()].flatMap(({ walk }) => (walk ? [walk] : []));
  const decoded = progress.nodes - progress.left;
  const [state, line] = overall(walks, decoded, progress.nodes);
  const dark = progress.left === 0 ? "Nothing is dark any more." : `${progress.left} still dark: only who finds them can read them.`;
  if (!chosen?.walk) return [state, line, dark, driven].join("\n");
  const learnt = driftWords(chosen.walk.drift);
  const told = [`${shortName(chosen)}: ${walkWords(chosen.walk)}`, learnt && `By its landmarks its wheels err: ${learnt}.`];
  return [state, line, dark, ...told.filter(Boolean)].join("\n");
}

function overall(walks: readonly Walk[], decoded: number, nodes: number): readonly [string, string] {
  const done = walks.filter(({ phase }) => phase === "done").length;
  const over = walks.length > 0 && walks.every(({ phase }) => phase === "done" || phase === "held");
  const count = `${decoded} of ${nodes} decoded`;
  if (over && done === walks.length) return ["done", `Mission completed: ${count}, all robots have stopped.`];
  if (over) return ["stopped", `All robots have stopped, ${done} of ${walks.length} completed: ${count}.`];
  if (done > 0) return ["running", `${count}; ${done} of ${walks.length} robots completed the mission.`];
  return ["running", `${count}.`];
}

/** How far a robot is, in plain words. */
export function walkWords({ phase, decoded, of, why }: Walk): string {
  const count = of > 0 ? `, decoded ${decoded} of ${of}` : "";
  const because = why === "" ? "" : ` (${why})`;
  switch (phase) {
    case "waiting":
      return "waiting to begin";
    case "seeking":
      return `seeking the next landmark${count}`;
    case "returning":
      return `did not find it${because}: going back to its last landmark${count}`;
    case "held":
      return `held: it stopped${because}${count}`;
    case "done":
      return `mission completed${count}`;
  }
}
