// The broker, its visitors, and the messages.

import { operator as texts } from "../texts";
import { type Broker, COUNTERS, type Counters, type Visitor } from "./gateway_state";
import { rate, type TotalsAt } from "./rates";
import { ago, grouped, perSecond } from "./words";
import { Term } from "./terms";

export function BrokerCard({ broker }: { readonly broker: Broker }) {
  return (
    <section className="card" data-testid="broker" data-connected={broker.connected} aria-labelledby="broker-title">
      <header>
        <h2 id="broker-title"><Term of="broker">{texts.broker}</Term></h2>
        <span className="tag" data-link={broker.connected ? "ok" : "lost"}>
          {broker.connected ? texts.connected : texts.notConnected}
        </span>
      </header>
      <p className="mono wrap">{withoutCredentials(broker.url)}</p>
      <p className="quiet">{texts.brokerCannotRead(texts.brokers[broker.name] ?? broker.name)}</p>
    </section>
  );
}

export function VisitorsCard({ visitors }: { readonly visitors: readonly Visitor[] }) {
  const recent = [...visitors].sort((a, b) => a.last_seen_s - b.last_seen_s);
  return (
    <section className="card visitors" data-testid="visitors" aria-labelledby="visitors-title">
      <header>
        <h2 id="visitors-title">
          <Term of="visitors">{texts.sharedCode}</Term> <span className="count">{visitors.length}</span>
        </h2>
      </header>
      {recent.length === 0 ? (
        <p className="quiet">{texts.nobodyYet}</p>
      ) : (
        <ul className="scroll" tabIndex={0} aria-label={texts.recentVisitors}>
          {recent.map((visitor) => (
            <li key={visitor.id}>
              <span className="mono visitor-id" title={visitor.id}>
                {visitor.id}
              </span>
              <span className="quiet number">
                {texts.requests(visitor.requests, grouped(visitor.requests))} · {ago(visitor.last_seen_s)}
              </span>
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}

interface CountersProps {
  readonly counters: Counters;
  readonly window: readonly TotalsAt[];
}

export function CountersCard({ counters, window }: CountersProps) {
  return (
    <section className="card" data-testid="counters" aria-labelledby="counters-title">
      <header>
        <h2 id="counters-title"><Term of="messages">{texts.messages}</Term></h2>
      </header>
      <table>
        <thead>
          <tr>
            <th scope="col">{texts.kind}</th>
            <th scope="col" className="right">
              {texts.total}
            </th>
            <th scope="col" className="right">
              {texts.perSecond}
            </th>
          </tr>
        </thead>
        <tbody>
          {COUNTERS.map((name) => {
            const perS = rate(window, name);
            const [title, meaning] = texts.counters[name];
            return (
              <tr key={name} data-counter={name}>
                <th scope="row">
                  {title} <span className="quiet">{meaning}</span>
                </th>
                <td className="number right">{grouped(counters[name])}</td>
                <td className="number right">{perS === undefined ? "–" : perSecond(perS)}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </section>
  );
}

/** Remove credentials: an external broker's URL may have a password, and this page is on a projector. */
export function withoutCredentials(url: string): string {
  return url.replace(/\/\/[^/]*@/, "//");
}
