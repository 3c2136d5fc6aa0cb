// What a compiled mission is worth: what an attacker with the file must try, what the robot must, and what looks wrong.

import { operator as texts } from "../../texts";
import type { Compiled } from "./desk";

const UNITS = [
  [31_557_600, "years"],
  [86_400, "days"],
  [3600, "h"],
  [60, "min"],
  [1, "s"],
  [1e-3, "ms"],
] as const;

/** A time in the unit that people would use. */
export function span(seconds: number): string {
  for (const [size, unit] of UNITS) if (seconds >= size) return `${brief(seconds / size)} ${unit === "years" || unit === "days" ? texts.units[unit] : unit}`;
  return `${brief(seconds * 1e6)} µs`;
}

/** Three digits that matter. */
export function brief(value: number): string {
  return value >= 1e5 ? value.toExponential(2).replace("e+", "e") : String(Number(value.toPrecision(3)));
}

export function Worth({ compiled }: { readonly compiled: Compiled }) {
  const { rows, rates } = compiled;
  return (
    <section className="worth" data-testid="audit" aria-label={texts.auditOf}>
      <div className="scroll" tabIndex={0} role="region" aria-label={texts.auditByNode}>
        <table>
          <thead>
            <tr>
              <th scope="col">{texts.node}</th>
              <th scope="col" className="right">
                {texts.toTry}
              </th>
              <th scope="col" className="right">
                {texts.oneCore}
              </th>
              <th scope="col" className="right">
                {texts.oneGpu}
              </th>
              <th scope="col" className="right">
                {texts.robot}
              </th>
            </tr>
          </thead>
          <tbody>
            {rows.map((row) => (
              <tr key={row.name}>
                <th scope="row">
                  {row.name}
                  {row.problems.map((problem) => (
                    <span key={problem} className="problem">
                      {problem}
                    </span>
                  ))}
                </th>
                <td className="right number">{row.out_of_reach ? "> 2^128" : brief(row.candidates)}</td>
                <td className="right number">{row.out_of_reach ? "–" : span(row.core_s)}</td>
                <td className="right number">{row.out_of_reach ? "–" : span(row.gpu_s)}</td>
                <td className="right number">{brief(row.robot_ms)} ms</td>
              </tr>
            ))}
          </tbody>
          <tfoot>
            <tr>
              <th scope="row" colSpan={2}>
                {texts.allThatCanBeGuessed}
              </th>
              <td className="right number">{compiled.core_s === null ? texts.nothing : span(compiled.core_s)}</td>
              <td className="right number">{compiled.gpu_s === null ? texts.nothing : span(compiled.gpu_s)}</td>
              <td />
            </tr>
          </tfoot>
        </table>
      </div>
      {compiled.unseen.map((name) => (
        <p key={name} className="trouble">
          {texts.notShown(name)}
        </p>
      ))}
      {compiled.notes.map((note) => (
        <p key={note}>{texts.note(note)}</p>
      ))}
      <p className="quiet">
        {texts.assumed(brief(rates.hash_core), brief(rates.hash_gpu), brief(rates.kdf_core), brief(rates.kdf_gpu))}
      </p>
    </section>
  );
}
