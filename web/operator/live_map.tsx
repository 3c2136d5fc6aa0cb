// The map for the projector: the robots as visitors see them, and in large letters the state of the compromised one.

import { useState } from "react";
import { MapView } from "../map/map_view";
import { common, operator as texts } from "../texts";
import type { GatewayState, Lie, Robot } from "./gateway_state";
import type { Station } from "./station";

interface Props {
  readonly station: Station;
  readonly state: GatewayState;
}

export function LiveMap({ station, state }: Props) {
  const [chosen, setChosen] = useState<string>();
  const newest = newestLie(state);
  return (
    <section className="live" aria-label={texts.liveMap}>
      <MapView link={station.source} selected={chosen ?? newest?.robot.address} onSelect={(address) => setChosen(address === chosen ? undefined : address)} />
      <p className="live-words" data-testid="live-words" data-stopped={newest?.lie.stopped_after_s !== undefined} hidden={!newest}>
        {newest && <LieWords {...newest} />}
      </p>
    </section>
  );
}

interface Newest {
  readonly robot: Robot;
  readonly lie: Lie;
  readonly attack: string;
}

function newestLie({ robots, shields }: GatewayState): Newest | undefined {
  const lying = robots.flatMap((robot) => {
    const shield = shields?.robots[robot.address];
    return shield?.lie ? [{ robot, lie: shield.lie, attack: shield.attack }] : [];
  });
  return lying.sort((a, b) => a.lie.since_s - b.lie.since_s)[0];
}

function LieWords({ robot, lie, attack }: Newest) {
  if (lie.stopped_after_s !== undefined) {
    return (
      <>
        <strong>{texts.wasStopped(robot.name)}</strong>
        {texts.byTheOthers(common.decimal(lie.stopped_after_s, 1))}
      </>
    );
  }
  return (
    <>
      <strong>{texts.lies(robot.name)}</strong>
      {texts.liesFor(attack, Math.floor(lie.since_s))}
    </>
  );
}
