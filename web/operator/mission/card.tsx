// The mission that runs, in a line or two.

import type { Missions } from "../gateway_state";
import { Term } from "../terms";

export function MissionCard({ mission }: { readonly mission: Missions }) {
  const { world, running, robots } = mission;
  const count = Object.keys(robots).length;
  return (
    <section className="card" data-testid="mission-card" aria-labelledby="mission-title">
      <header>
        <h2 id="mission-title"><Term of="mission">Mission</Term>{running && `: ${running.name}`}</h2>
        <span className="quiet">{world}</span>
      </header>
      {running ? (
        <>
          <progress className="decoded" max={running.nodes} value={running.nodes - running.left} aria-label="Decoded" />
          <p>
            {running.nodes - running.left} of {running.nodes} decoded; {running.completed} of {count} robots completed it.
          </p>
        </>
      ) : (
        <p>The robots wait for one: draw it in the mission editor.</p>
      )}
    </section>
  );
}
