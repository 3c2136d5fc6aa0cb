// The robots, one per row.

import { type SwarmSource, useSwarm } from "../client";
import { MarkChip } from "../map/mark_chip";
import { common, operator as texts } from "../texts";
import type { LinkQuality, Missions, Rgb, Robot, RobotShield, Shields, Walk } from "./gateway_state";
import { ago, driftWords } from "./words";
import { Term } from "./terms";

// Voltage range of a DotBot: brown-out below, freshly charged above.
const EMPTY_V = 1.8;
const FULL_V = 3.0;
const LOW = 0.25;

const LINKS: readonly LinkQuality[] = ["ok", "quiet", "lost"];
const STATUS = ["active", "inactive", "lost"] as const;
const MODE = ["manual", "route"] as const;

interface Props {
  readonly source: SwarmSource;
  readonly robots: readonly Robot[];
  readonly shields: Shields | undefined;
  readonly mission: Missions | undefined;
}

export function Fleet({ source, robots, shields, mission }: Props) {
  const addresses = useSwarm(source, ({ swarm }) => swarm.numbers);
  const numbers = new Map([...addresses].map(([number, address]) => [address, number]));
  const byName = new Intl.Collator(texts.locale, { numeric: true });
  const sorted = [...robots].sort((a, b) => byName.compare(a.name, b.name) || byName.compare(a.address, b.address));
  const counted = LINKS.map((link) => [link, robots.filter((robot) => robot.link === link).length] as const);

  return (
    <section className="card fleet" aria-labelledby="fleet-title">
      <header>
        <h2 id="fleet-title">
          <Term of="fleet">{texts.fleet}</Term> <span className="count">{robots.length}</span>
        </h2>
        <p className="tally">
          {counted.map(([link, n]) => (
            <span key={link} className="tag" data-link={link} data-none={n === 0}>
              {n} {texts.links[link]}
            </span>
          ))}
        </p>
      </header>
      <section className="scroll" aria-label={texts.robots} tabIndex={0}>
        <table data-testid="fleet-table">
          <thead>
            <tr>
              <th scope="col">{texts.robot}</th>
              <th scope="col"><Term of="led">{texts.led}</Term></th>
              <th scope="col">{texts.battery}</th>
              <th scope="col"><Term of="drive">{texts.drives}</Term></th>
              <th scope="col"><Term of="heard">{texts.heard}</Term></th>
              <th scope="col"><Term of="link">{texts.link}</Term></th>
              {shields && <th scope="col"><Term of="shield">{texts.shield}</Term></th>}
              {mission && <th scope="col"><Term of="mission">{texts.mission}</Term></th>}
            </tr>
          </thead>
          <tbody>
            {sorted.map((robot) => (
              <Row
                key={robot.address}
                robot={robot}
                number={numbers.get(robot.address)}
                needed={shields?.tokens_needed}
                shield={shields?.robots[robot.address]}
                walk={mission?.robots[robot.address]}
              />
            ))}
          </tbody>
        </table>
        {robots.length === 0 && <p className="quiet empty">{texts.noRobotHeard}</p>}
      </section>
    </section>
  );
}

/** Published pages send no names. */
function modeWords({ mode, drivers }: Robot): string {
  return drivers.length === 0 ? texts.modes[MODE[mode]] : texts.drivenBy(drivers.map((name) => name || texts.aVisitor).join(", "));
}

interface RowProps {
  readonly robot: Robot;
  readonly number: number | undefined;
  readonly needed: number | undefined;
  readonly shield: RobotShield | undefined;
  readonly walk: Walk | undefined;
}

function Row({ robot, number, needed, shield, walk }: RowProps) {
  return (
    <tr data-status={STATUS[robot.status]} data-safe-mode={shield?.safe_mode === true}>
      <th scope="row">
        <MarkChip number={number} />
        <span className="robot-name">{robot.name}</span>
        <span className="address" title={robot.address}>
          …{robot.address.slice(-4)}
        </span>
      </th>
      <td>
        <Led rgb={robot.rgb_led} />
      </td>
      <td>
        <Battery volts={robot.battery_v} />
      </td>
      <td data-testid="mode">{walk ? texts.modes.mission : modeWords(robot)}</td>
      <td className="number">{ago(robot.last_seen_s)}</td>
      <td>
        <span className="tag" data-link={robot.link} title={texts.robotIs[STATUS[robot.status]]}>
          {texts.links[robot.link]}
        </span>
      </td>
      {needed !== undefined && <td>{shield && <Shield shield={shield} needed={needed} />}</td>}
      {walk && (
        <td className="number" title={walk.why}>
          <span className="tag" data-link={walk.phase === "done" ? "ok" : walk.phase === "held" ? "lost" : "quiet"}>
            {common.phases[walk.phase]}
          </span>{" "}
          {walk.of > 0 && `${walk.decoded}/${walk.of}`}
          <span className="drift">{driftWords(walk.drift)}</span>
        </td>
      )}
    </tr>
  );
}

function Shield({ shield, needed }: { readonly shield: RobotShield; readonly needed: number }) {
  const { safe_mode, attack, vouchers } = shield;
  // Without the last needed token the robot is stopped.
  const left_s = vouchers[needed - 1]?.left_s;
  return (
    <>
      {safe_mode ? (
        <span className="tag" data-link="lost">
          <Term of="safeMode">{texts.safeMode}</Term>
        </span>
      ) : (
        <span className="number" title={vouchers.map(({ name, left_s: s }) => `${name} ${common.seconds(s)}`).join(", ")}>
          {Math.min(vouchers.length, needed)}/{needed}
          {left_s !== undefined && ` · ${common.seconds(Math.ceil(left_s))}`}
        </span>
      )}
      {attack !== "" && (
        <span className="tag" data-link="quiet">
          {attack}
        </span>
      )}
    </>
  );
}

function Led({ rgb }: { readonly rgb: Rgb }) {
  const off = rgb.red + rgb.green + rgb.blue === 0;
  const words = off ? texts.off : texts.colour(rgb.red, rgb.green, rgb.blue);
  return (
    <span
      className="led"
      role="img"
      aria-label={words}
      title={words}
      data-off={off}
      style={off ? undefined : { backgroundColor: `rgb(${rgb.red} ${rgb.green} ${rgb.blue})` }}
    />
  );
}

function Battery({ volts }: { readonly volts: number }) {
  if (volts === 0) return <span className="number">–</span>; // the robot does not report it
  const part = Math.max(0, Math.min(1, (volts - EMPTY_V) / (FULL_V - EMPTY_V)));
  return (
    <span className="battery">
      <span className="battery-shell" aria-hidden="true">
        <span className="battery-charge" data-low={part < LOW} style={{ width: `${Math.round(part * 100)}%` }} />
      </span>
      <span className="number">{texts.volts(common.decimal(volts, 1))}</span>
    </span>
  );
}
