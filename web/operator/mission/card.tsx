// The running mission in one or two lines.

import { operator as texts } from "../../texts";
import type { Missions } from "../gateway_state";
import { Term } from "../terms";

export function MissionCard({ mission }: { readonly mission: Missions }) {
  const { world, running, robots } = mission;
  const count = Object.keys(robots).length;
  return (
    <section className="card" data-testid="mission-card" aria-labelledby="mission-title">
      <header>
        <h2 id="mission-title"><Term of="mission">{texts.mission}</Term>{running && texts.missionNamed(running.name)}</h2>
        <span className="quiet">{world}</span>
      </header>
      {running ? (
        <>
          <progress className="decoded" max={running.nodes} value={running.nodes - running.left} aria-label={texts.decodedBar} />
          <p>{texts.decodedOf(running.nodes - running.left, running.nodes, running.completed, count)}</p>
        </>
      ) : (
        <p>{texts.drawOne}</p>
      )}
    </section>
  );
}
