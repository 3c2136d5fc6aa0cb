// A run on a page: the map, what plays it, and what happened up to now.

import { useState, useSyncExternalStore } from "react";
import { counting } from "../client";
import { MapView } from "../map/map_view";
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
        <h1 className="brand">{about["name"] ?? (onMission ? "A mission" : "A run")}</h1>
        <p className="hint">{about["defence"] !== undefined && `defence ${about["defence"]}, seed ${about["seed"] ?? ""}`}</p>
      </header>
      <main>
        <section aria-label="Map">
          <MapView link={player} selected={chosen} onSelect={(address) => setChosen(address === chosen ? undefined : address)} />
          <div className="play" role="group" aria-label="Play">
            <button type="button" className="primary" data-testid="play" onClick={() => player.toggle()}>
              {playing ? "Pause" : "Play"}
            </button>
            <input
              type="range"
              aria-label="Time"
              aria-valuetext={`${t_s.toFixed(1)} of ${length.toFixed(0)} seconds`}
              min={0}
              max={length}
              step={0.05}
              value={t_s}
              onChange={(event) => player.change({ t_s: Math.min(Number(event.target.value), end_s) })}
            />
            <span className="clock" data-testid="clock">
              {t_s.toFixed(1)} s
            </span>
            <select aria-label="Speed" value={speed} onChange={(event) => player.change({ speed: Number(event.target.value) })}>
              {SPEEDS.map((times) => (
                <option key={times} value={times}>
                  {times} ×
                </option>
              ))}
            </select>
          </div>
          <p className="hint" role="status" data-testid="loaded">
            {away
              ? `phalanx does not answer: what came until then, ${end_s.toFixed(0)} s, still plays`
              : ended
                ? `all ${end_s.toFixed(0)} s are here`
                : `${end_s.toFixed(0)} s so far; it goes on`}
          </p>
        </section>
        <div className="beside">
          <section className="panel" aria-labelledby="robot-title">
            <h2 id="robot-title">{chosen === undefined ? "What is drawn" : `Robot ${chosen}`}</h2>
            {chosen === undefined ? (
              <Legend audited={terms !== undefined} onMission={onMission} />
            ) : (
              <Chosen player={player} address={chosen} onMission={onMission} />
            )}
          </section>
          <section className="panel" aria-labelledby="events-title">
            <h2 id="events-title">Until now: {past.length}</h2>
            {past.length === 0 && <p className="hint">{onMission ? "Nothing is decoded yet." : "No refusals yet."}</p>}
            {/* Old and new ones keep their keys: a screen reader is not told all of it again. */}
            <ul className="events" data-testid="events" tabIndex={0} aria-label="What happened, the newest first">
              {past.slice(-MOST_EVENTS).reverse().map(([at_s, robot, words], k) => (
                <li key={past.length - k}>
                  <button type="button" className="quiet" onClick={() => player.change({ t_s: at_s, playing: false })}>
                    {at_s.toFixed(1)} s
                  </button>
                  <span>
                    robot {robot}: {words}
                  </span>
                </li>
              ))}
            </ul>
          </section>
        </div>
      </main>
    </div>
  );
}

/** Only what can be on this map. */
function Legend({ audited, onMission }: { readonly audited: boolean; readonly onMission: boolean }) {
  return (
    <ul className="legend">
      <li>
        <i className="honest" /> {onMission ? "a robot, where it truly is" : "an honest robot"}
      </li>
      <li>
        <i className="lamp" /> {onMission ? "a landmark, from when somebody decoded it" : "the goal"}
      </li>
      {!onMission && (
        <li>
          <i className="liar" /> a compromised one: it “lies”
        </li>
      )}
      {audited && (
        <>
          <li>
            <i className="stopped" /> stopped, in Safe Mode: grey, its ring in pieces
          </li>
          <li>
            <i className="token" /> a token of the ring: another robot vouches for it
          </li>
          <li>
            <i className="refused" /> a line with a cross: an audit that was refused
          </li>
          <li>Tap a robot to read its shield.</li>
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
  if (!robot) return <p>It is not here yet.</p>;
  const step = player.run.steps[Math.max(player.run.indexAt(player.moment.t_s), 0)];
  const lies = step?.lies.find(([number]) => number === robot.number)?.[1];
  const tokens = robot.shield && terms ? counting(robot.shield, terms, at_ms) : [];
  return (
    <>
      <p data-testid="shield">
        {robot.shield?.safeMode === true
          ? "Stopped, in Safe Mode: it has no tokens."
          : terms
            ? `${tokens.length} of ${terms.needed} tokens`
            : onMission
              ? "A mission's recording does not say who vouches for whom."
              : "Nobody vouches for robots in this run."}
      </p>
      {lies !== undefined && <p>Compromised: {lies}</p>}
      <ul>
        {tokens.map(({ auditor, until_ms }) => (
          <li key={auditor}>
            robot {auditor} vouches for {((until_ms - at_ms) / 1000).toFixed(1)} s more
          </li>
        ))}
      </ul>
    </>
  );
}
