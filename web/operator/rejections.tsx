// Refused messages, explained.

import { operator as texts } from "../texts";
import { rate, type TotalsAt } from "./rates";
import { reason } from "./reasons";
import { grouped, perSecond } from "./words";
import { Term } from "./terms";

interface Props {
  readonly rejected: Readonly<Record<string, number>>;
  readonly window: readonly TotalsAt[];
}

export function Rejections({ rejected, window }: Props) {
  const rows = Object.entries(rejected)
    .filter(([, n]) => n > 0)
    .sort(([a, m], [b, n]) => n - m || a.localeCompare(b));
  const total = rows.reduce((sum, [, n]) => sum + n, 0);

  return (
    <section className="card" data-testid="rejections" aria-labelledby="rejections-title">
      <header>
        <h2 id="rejections-title">
          <Term of="refused">{texts.refusedMessages}</Term> <span className="count">{grouped(total)}</span>
        </h2>
      </header>
      {rows.length === 0 ? (
        <p className="quiet">{texts.noneRefused}</p>
      ) : (
        <ul className="rejections">
          {rows.map(([name, n]) => {
            const { title, text, tone } = reason(name);
            const perS = rate(window, name) ?? 0;
            return (
              <li key={name} data-reason={name} data-tone={tone}>
                <p className="rejection-head">
                  <strong>{title}</strong> <span className="tag tone">{texts.tones[tone]}</span>
                  <span className="number rejection-n">
                    {grouped(n)}
                    {perS > 0 && <span className="quiet">{texts.aSecond(perSecond(perS))}</span>}
                  </span>
                </p>
                <p className="quiet">{text}</p>
              </li>
            );
          })}
        </ul>
      )}
    </section>
  );
}
