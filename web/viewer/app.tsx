// A page that shows a run: the map, its controls, and the events so far.

import { useState, useSyncExternalStore } from "react";
import { counting } from "../client";
import { MapView } from "../map/map_view";
import { common, viewer as texts } from "../texts";
import { type Player, SPEEDS } from "./player";

const MOST_EVENTS = 60;

export function App({ player }: { readonly player: Player }) {
  const { t_s, playing, speed, away } = useSyncExternalStore(player.subscribe, () => player.moment);
  const [chosen, setChosen] = useState<string>();
  const { about, ended, end_s } = player.run;
  const { terms, missions } = player.view.swarm;
  const onMission = (missions?.walls ?? []).length > 0;
  const past = player.run.events.filter(([at_s]) => at_s <= t_s);
  const length = ended ? end_s : Math.max(end_s, Number(about["duration_s"] ?? 0));
  return (
    <div className="page view">
      <header className="top">
        <h1 className="brand">{about["name"] ?? (onMission ? texts.aMission : texts.aRun)}</h1>
        <p className="hint">{about["defence"] !== undefined && texts.defence(about["defence"], about["seed"] ?? "")}</p>
      </header>
      <main>
        <section aria-label={texts.map}>
          <MapView link={player} marked={false} selected={chosen} onSelect={(address) => setChosen(address === chosen ? undefined : address)} />
          <div className="play" role="group" aria-label={texts.playing}>
            <button type="button" className="primary" data-testid="play" onClick={() => player.toggle()}>
              {playing ? texts.pause : texts.play}
            </button>
            <input
              type="range"
              aria-label={texts.time}
              aria-valuetext={texts.timeOf(common.decimal(t_s, 1), length.toFixed(0))}
              min={0}
              max={length}
              step={0.05}
              value={t_s}
              onChange={(event) => player.change({ t_s: Math.min(Number(event.target.value), end_s) })}
            />
            <span className="clock" data-testid="clock">
              {common.seconds(common.decimal(t_s, 1))}
            </span>
            <select aria-label={texts.speed} value={speed} onChange={(event) => player.change({ speed: Number(event.target.value) })}>
              {SPEEDS.map((times) => (
                <option key={times} value={times}>
                  {texts.times(times)}
                </option>
              ))}
            </select>
          </div>
          <p className="hint" role="status" data-testid="loaded">
            {away
              ? texts.away(end_s.toFixed(0))
              : ended
                ? texts.allHere(end_s.toFixed(0))
                : texts.soFar(end_s.toFixed(0))}
          </p>
        </section>
        <div className="beside">
          <section className="panel" aria-labelledby="robot-title">
            <h2 id="robot-title">{chosen === undefined ? texts.whatIsDrawn : texts.robotNumber(chosen)}</h2>
            {chosen === undefined ? (
              <Legend audited={terms !== undefined} onMission={onMission} />
            ) : (
              <Chosen player={player} address={chosen} onMission={onMission} />
            )}
          </section>
          <section className="panel" aria-labelledby="events-title">
            <h2 id="events-title">{texts.untilNow(past.length)}</h2>
            {past.length === 0 && <p className="hint">{onMission ? texts.nothingDecoded : texts.noRefusals}</p>}
            {/* Entries keep their keys, so that a screen reader does not read them again. */}
            <ul className="events" data-testid="events" tabIndex={0} aria-label={texts.whatHappened}>
              {past.slice(-MOST_EVENTS).reverse().map(([at_s, robot, words], k) => (
                <li key={past.length - k}>
                  <button type="button" className="quiet" onClick={() => player.change({ t_s: at_s, playing: false })}>
                    {common.seconds(common.decimal(at_s, 1))}
                  </button>
                  <span>{texts.event(robot, words)}</span>
                </li>
              ))}
            </ul>
          </section>
        </div>
      </main>
    </div>
  );
}

/** Only the symbols that can occur on this map. */
function Legend({ audited, onMission }: { readonly audited: boolean; readonly onMission: boolean }) {
  return (
    <ul className="legend">
      <li>
        <i className="honest" /> {onMission ? texts.robotTruly : texts.honestRobot}
      </li>
      <li>
        <i className="lamp" /> {onMission ? texts.decodedLandmark : texts.theGoal}
      </li>
      {!onMission && (
        <li>
          <i className="liar" /> {texts.compromisedOne}
        </li>
      )}
      {audited && (
        <>
          <li>
            <i className="stopped" /> {texts.stoppedOne}
          </li>
          <li>
            <i className="token" /> {texts.tokenOfTheRing}
          </li>
          <li>
            <i className="refused" /> {texts.refusedLine}
          </li>
          <li>{texts.tapToRead}</li>
        </>
      )}
    </ul>
  );
}

interface ChosenProps {
  readonly player: Player;
  readonly address: string;
  readonly onMission: boolean;
}

function Chosen({ player, address, onMission }: ChosenProps) {
  const { robots, terms, at_ms } = player.view.swarm;
  const robot = robots.get(address);
  if (!robot) return <p>{texts.notHereYet}</p>;
  const step = player.run.steps[Math.max(player.run.indexAt(player.moment.t_s), 0)];
  const lies = step?.lies.find(([number]) => number === robot.number)?.[1];
  const tokens = robot.shield && terms ? counting(robot.shield, terms, at_ms) : [];
  return (
    <>
      <p data-testid="shield">
        {robot.shield?.safeMode === true
          ? texts.stoppedNoTokens
          : terms
            ? texts.tokensOf(tokens.length, terms.needed)
            : onMission
              ? texts.recordingSaysNot
              : texts.nobodyVouches}
      </p>
      {lies !== undefined && <p>{texts.compromised(lies)}</p>}
      <ul>
        {tokens.map(({ auditor, until_ms }) => (
          <li key={auditor}>{texts.vouchesFor(auditor, common.decimal((until_ms - at_ms) / 1000, 1))}</li>
        ))}
      </ul>
    </>
  );
}
