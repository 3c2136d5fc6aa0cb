// The audit of a compiled mission: the attacker's work, the robot's work, and warnings.

import { operator as texts } from "../../texts";
import type { Compiled, WorthRow } from "./desk";

const UNITS = [
  [31_557_600, "years"],
  [86_400, "days"],
  [3600, "h"],
  [60, "min"],
  [1, "s"],
  [1e-3, "ms"],
] as const;

const COSTS = ["most", "nearest", "plan"] as const;

/** A duration in a convenient unit. */
export function span(seconds: number): string {
  for (const [size, unit] of UNITS) if (seconds >= size) return `${brief(seconds / size)} ${unit === "years" || unit === "days" ? texts.units[unit] : unit}`;
  return `${brief(seconds * 1e6)} µs`;
}

/** Three significant digits. */
export function brief(value: number): string {
  return value >= 1e5 ? value.toExponential(2).replace("e+", "e") : String(Number(value.toPrecision(3)));
}

/** Warnings, node by node, as the command prints them. */
export function findings({ rows, unseen }: Compiled): readonly string[] {
  return [
    ...rows.flatMap((row) => looks(row).map((look) => `${row.name}: ${look}`)),
    ...unseen.map((name) => texts.notShown(name)),
  ];
}

function looks({ infeasible, problems }: WorthRow): readonly string[] {
  return [...infeasible.map((why) => `infeasible ${why}`), ...problems];
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
                {texts.withMap}
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
                  {looks(row).map((problem) => (
                    <span key={problem} className="problem">
                      {problem}
                    </span>
                  ))}
                </th>
                <td className="right number">{row.out_of_reach ? "> 2^128" : brief(row.candidates)}</td>
                <td className="right number">{row.out_of_reach ? "–" : span(row.core_s)}</td>
                <td className="right number">{row.out_of_reach ? "–" : span(row.gpu_s)}</td>
                <td className="right number">{row.out_of_reach || row.by_plan === null ? "–" : brief(row.by_plan)}</td>
                <td className="right number">{brief(row.robot_ms)} ms</td>
              </tr>
            ))}
          </tbody>
          <tfoot>
            {COSTS.map((how) => (
              <tr key={how}>
                <th scope="row" colSpan={2}>
                  {texts.allThatCanBeGuessed[how]}
                </th>
                {compiled.costs[how].map((cost_s, i) => (
                  <td key={i} className="right number">
                    {cost_s === null ? texts.nothing : span(cost_s)}
                  </td>
                ))}
                <td colSpan={2} />
              </tr>
            ))}
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
