// Visitors with sessions: present, waiting and driving, with the operator's actions on each.

import { useEffect, useState } from "react";
import { operator as texts } from "../texts";
import type { Robot, Session, SessionVisitor } from "./gateway_state";
import { order, type Station } from "./station";
import { Term } from "./terms";

/** A second click within this time confirms. */
const CONFIRM_MS = 4000;

interface Props {
  readonly station: Station;
  readonly session: Session;
  readonly robots: readonly Robot[];
}

export function SessionCard({ station, session, robots }: Props) {
  const [trouble, setTrouble] = useState<string>();
  // A closed page of this machine is not shown.
  const visitors = session.visitors.filter(({ role, present }) => present || role !== "operate");
  const present = visitors.filter((each) => each.present);
  const act: Act = async (what, words = {}) => setTrouble(await order(station, what, words));
  return (
    <section className="card visitors" data-testid="session" aria-labelledby="session-title">
      <header>
        <h2 id="session-title">
          <Term of="session">{texts.visitors}</Term> <span className="count">{present.length}</span>
        </h2>
        <span className="tag" data-link={session.open ? "ok" : "quiet"} data-testid="door-state">
          {session.open ? texts.newcomersLetIn : texts.newcomersWait}
        </span>
      </header>
      <div className="buttons">
        <button
          type="button"
          data-testid="door"
          data-tip={texts.terms.door}
          aria-description={texts.terms.door}
          onClick={() => void act("door", { open: !session.open })}
        >
          {session.open ? texts.closeTheDoor : texts.openTheDoor}
        </button>
        <Confirmed
          testid="everybody-out"
          label={texts.everybodyOut}
          sure={texts.reallyEverybody}
          tip={texts.terms.everybodyOut}
          onSure={() => void act("everybody_out")}
        />
      </div>
      {trouble !== undefined && (
        <p className="trouble" role="alert">
          {trouble}
        </p>
      )}
      {visitors.length === 0 ? (
        <p className="quiet">{texts.nobodyYet}</p>
      ) : (
        <section className="scroll" aria-label={texts.visitorsAndRoles} tabIndex={0}>
          <table data-testid="session-table">
            <thead>
              <tr>
                <th scope="col">{texts.name}</th>
                <th scope="col">
                  <Term of="role">{texts.role}</Term>
                </th>
                <th scope="col">
                  <Term of="assigned">{texts.robot}</Term>
                </th>
                <th scope="col">
                  <span className="unseen">{texts.actions}</span>
                </th>
              </tr>
            </thead>
            <tbody>
              {visitors.map((visitor) => (
                <Row key={visitor.visitor} visitor={visitor} visitors={visitors} robots={robots} act={act} />
              ))}
            </tbody>
          </table>
        </section>
      )}
    </section>
  );
}

type Act = (what: string, words?: object) => Promise<void>;

interface RowProps {
  readonly visitor: SessionVisitor;
  readonly visitors: readonly SessionVisitor[];
  readonly robots: readonly Robot[];
  readonly act: Act;
}

function Row({ visitor, visitors, robots, act }: RowProps) {
  const { visitor: id, name, role, waiting, present } = visitor;
  const called = name === "" ? texts.visitorNumber(id) : name;
  return (
    <tr data-visitor={id} data-waiting={waiting} data-present={present}>
      <th scope="row">
        <span className="robot-name">{called}</span>
        {!present && <span className="tag">{texts.away}</span>}
      </th>
      <td>{waiting ? <span className="tag" data-link="quiet">{texts.waits}</span> : texts.roles[role]}</td>
      <td>{waiting ? "" : <Drives visitor={visitor} visitors={visitors} robots={robots} act={act} called={called} />}</td>
      <td className="acts">
        {waiting && (
          <button type="button" className="primary" aria-label={texts.letNameIn(called)} onClick={() => void act("approve", { visitor: id })}>
            {texts.letIn}
          </button>
        )}
        {!waiting && role !== "operate" && (
          <button
            type="button"
            aria-label={role === "drive" ? texts.letNameWatch(called) : texts.letNameDrive(called)}
            onClick={() => void act("role", { visitor: id, role: role === "drive" ? "watch" : "drive" })}
          >
            {role === "drive" ? texts.watchOnly : texts.letDrive}
          </button>
        )}
        <Confirmed
          testid="remove"
          label={texts.remove}
          sure={texts.really}
          tip={texts.terms.remove}
          called={texts.removeName(called)}
          onSure={() => void act("remove", { visitor: id })}
        />
      </td>
    </tr>
  );
}

/** Assign a robot, release it, or exchange two. */
function Drives({ visitor, visitors, robots, act, called }: RowProps & { readonly called: string }) {
  const { visitor: id, robot, role, place } = visitor;
  if (role === "watch") return <span className="quiet">–</span>;
  function choose(address: string) {
    if (address === "") return act("take", { robot });
    const isTaken = visitors.some((each) => each.visitor !== id && each.robot === address);
    if (isTaken && robot !== "") return act("swap", { robots: [robot, address] });
    return act("give", { visitor: id, robot: address });
  }
  return (
    <>
      <select aria-label={texts.robotOf(called)} data-testid="robot-of" value={robot} onChange={(event) => void choose(event.target.value)}>
        <option value="">{texts.none}</option>
        {robots.map((each) => (
          <option key={each.address} value={each.address}>
            {each.name}
          </option>
        ))}
      </select>
      {place > 0 && <span className="quiet">{texts.inQueue(place)}</span>}
    </>
  );
}

interface ConfirmedProps {
  readonly testid: string;
  readonly label: string;
  readonly sure: string;
  readonly tip: string;
  readonly called?: string;
  readonly onSure: () => void;
}

/** A button for an irreversible action: the first click asks for confirmation. */
function Confirmed({ testid, label, sure, tip, called, onSure }: ConfirmedProps) {
  const [asks, setAsks] = useState(false);
  useEffect(() => {
    if (!asks) return;
    const timer = setTimeout(() => setAsks(false), CONFIRM_MS);
    return () => clearTimeout(timer);
  }, [asks]);
  return (
    <button
      type="button"
      className={asks ? "danger" : ""}
      data-testid={testid}
      data-tip={tip}
      aria-description={tip}
      aria-label={called && (asks ? `${called}: ${sure}` : called)}
      onClick={() => {
        if (asks) onSure();
        setAsks(!asks);
      }}
    >
      {asks ? sure : label}
    </button>
  );
}
