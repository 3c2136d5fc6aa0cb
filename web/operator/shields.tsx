// Robots that audit each other: the operator compromises one, and the others refuse it.

import { useState } from "react";
import { sentence } from "../client";
import { common, Mixed, operator as texts } from "../texts";
import type { Lie, Refusal, Robot, Shields } from "./gateway_state";
import { order, type Station } from "./station";
import { ago } from "./words";
import { Term } from "./terms";

interface Props {
  readonly station: Station;
  readonly robots: readonly Robot[];
  readonly shields: Shields;
}

export function CompromiseCard({ station, robots, shields }: Props) {
  const [address, setAddress] = useState("");
  const [name, setName] = useState("");
  const [trouble, setTrouble] = useState<string>();
  const [busy, setBusy] = useState(false);
  const honest = robots.filter((robot) => {
    const shield = shields.robots[robot.address];
    return shield && !shield.safe_mode && shield.attack === "";
  });
  // No robot is preselected: a second, impatient click would compromise another one. A choice ends with
  // its robot.
  const robot = honest.find((each) => each.address === address);
  const attack = shields.attacks.find((each) => each.name === name) ?? shields.attacks[0];
  const lying = robots.flatMap((each) => {
    const shield = shields.robots[each.address];
    return shield?.lie ? [{ robot: each, attack: shield.attack, lie: shield.lie }] : [];
  });
  const tolerated = shields.tokens_needed - 1;

  async function onSubmit() {
    if (!robot || !attack) return;
    setBusy(true);
    const refused = await order(station, "compromise", { address: robot.address, attack: attack.name });
    setTrouble(refused);
    if (refused === undefined) setAddress("");
    setBusy(false);
  }

  return (
    <section className="card compromise" data-testid="compromise" aria-labelledby="compromise-title">
      <header>
        <h2 id="compromise-title"><Mixed parts={texts.compromiseARobot(<Term of="compromise">{texts.compromise}</Term>)} /></h2>
        <span className="quiet">{texts.stoppedWithin(shields.t_val_ms / 1000)}</span>
      </header>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          void onSubmit();
        }}
      >
        <label>
          {texts.robot}
          <select data-testid="victim" value={robot?.address ?? ""} onChange={(event) => setAddress(event.target.value)}>
            <option value="">{texts.chooseOne}</option>
            {honest.map((each) => (
              <option key={each.address} value={each.address}>
                {each.name}
              </option>
            ))}
          </select>
        </label>
        <label>
          <Term of="attack">{texts.attack}</Term>
          <select data-testid="attack" value={attack?.name ?? ""} onChange={(event) => setName(event.target.value)}>
            {shields.attacks.map((each) => (
              <option key={each.name} value={each.name}>
                {each.name}
              </option>
            ))}
          </select>
        </label>
        <button type="submit" data-testid="compromise-button" disabled={busy || !robot || !attack}>
          {texts.compromiseNow}
        </button>
      </form>
      {lying.length > 0 && (
        <ul className="scroll lies" data-testid="lies" aria-live="polite" aria-label={texts.compromised}>
          {lying
            .sort((a, b) => a.lie.since_s - b.lie.since_s)
            .map((each) => (
              <Lying key={each.robot.address} {...each} />
            ))}
        </ul>
      )}
      <Stopped station={station} robots={robots} shields={shields} />
      {attack && (
        <p className="quiet">
          <Mixed parts={texts.whatItDoes(attack.does, <Term of="trusted">{texts.trustedNodes}</Term>)} />
        </p>
      )}
      {lying.length > tolerated && (
        <p className="trouble">{texts.moreThanTolerated(lying.length, tolerated)}</p>
      )}
      {trouble !== undefined && (
        <p className="trouble" role="alert">
          {trouble}
        </p>
      )}
    </section>
  );
}

/** Stopped robots, each with a button to revive it. */
function Stopped({ station, robots, shields }: Props) {
  const [asked, setAsked] = useState<ReadonlySet<string>>(new Set());
  const [trouble, setTrouble] = useState<string>();
  const stopped = robots.filter((robot) => shields.robots[robot.address]?.safe_mode);
  if (!shields.revives || stopped.length === 0) return null;

  async function revive(address: string) {
    setAsked((before) => new Set(before).add(address));
    const refused = await order(station, "revive", { robot: address });
    setTrouble(refused);
    // The robot needs some seconds to restart: a second click would be refused.
    setTimeout(() => setAsked((before) => new Set([...before].filter((each) => each !== address))), refused ? 0 : 8000);
  }

  return (
    <div className="revive" data-testid="stopped">
      {stopped.map(({ address, name }) => (
        <button key={address} type="button" disabled={asked.has(address)} onClick={() => void revive(address)}>
          {texts.revive(name)}
        </button>
      ))}
      {trouble !== undefined && (
        <p className="trouble" role="alert">
          {trouble}
        </p>
      )}
    </div>
  );
}

interface LyingProps {
  readonly robot: Robot;
  readonly attack: string;
  readonly lie: Lie;
}

function Lying({ robot, attack, lie: { since_s, stopped_after_s } }: LyingProps) {
  return (
    <li data-stopped={stopped_after_s !== undefined}>
      <strong>{robot.name}</strong>
      {texts.liesWith(attack)}
      {stopped_after_s !== undefined ? (
        texts.liarStopped(common.decimal(stopped_after_s, 1))
      ) : (
        // Hidden from screen readers: it changes every second.
        <span aria-hidden="true">{texts.liesSince(Math.floor(since_s))}</span>
      )}
    </li>
  );
}

export function UnprotectedCard({ why }: { readonly why: string }) {
  return (
    <section className="card" data-testid="unprotected" aria-labelledby="unprotected-title">
      <header>
        <h2 id="unprotected-title">{texts.noShields}</h2>
      </header>
      <p className="quiet">
        {why ? `${sentence(why)}.` : <Mixed parts={texts.doNotAudit(<Term of="audits">{texts.audit}</Term>)} />}
      </p>
    </section>
  );
}

export function AuditsCard({ refusals }: { readonly refusals: readonly Refusal[] }) {
  return (
    <section className="card audits" data-testid="refusals" aria-labelledby="refusals-title">
      <header>
        <h2 id="refusals-title"><Mixed parts={texts.refusedAudits(<Term of="audits">{texts.audits}</Term>)} /></h2>
      </header>
      {refusals.length === 0 ? (
        <p className="quiet">{texts.noneSoFar}</p>
      ) : (
        <ul className="scroll" tabIndex={0} aria-label={texts.refusedAuditsNewest}>
          {refusals.map((refusal, i) => (
            <li key={i}>
              <span>
                <Mixed parts={texts.refusedRobot(refusal.auditor, <strong>{refusal.auditee}</strong>, refusal.reason)} />
              </span>
              <span className="quiet number">{ago(refusal.ago_s)}</span>
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}
