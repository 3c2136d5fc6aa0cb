// What a compiled mission is worth: what an attacker with the file must try, what the robot must, and what looks wrong.

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
  for (const [size, unit] of UNITS) if (seconds >= size) return `${brief(seconds / size)} ${unit}`;
  return `${brief(seconds * 1e6)} µs`;
}

/** Three digits that matter. */
export function brief(value: number): string {
  return value >= 1e5 ? value.toExponential(2).replace("e+", "e") : String(Number(value.toPrecision(3)));
}

export function Worth({ compiled }: { readonly compiled: Compiled }) {
  const { rows, rates } = compiled;
  return (
    <section className="worth" data-testid="audit" aria-label="Audit">
      <div className="scroll" tabIndex={0} role="region" aria-label="Audit, node by node">
        <table>
          <thead>
            <tr>
              <th scope="col">Node</th>
              <th scope="col" className="right">
                To try
              </th>
              <th scope="col" className="right">
                One core
              </th>
              <th scope="col" className="right">
                One GPU
              </th>
              <th scope="col" className="right">
                Robot
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
                All that can be guessed
              </th>
              <td className="right number">{compiled.core_s === null ? "nothing" : span(compiled.core_s)}</td>
              <td className="right number">{compiled.gpu_s === null ? "nothing" : span(compiled.gpu_s)}</td>
              <td />
            </tr>
          </tfoot>
        </table>
      </div>
      {compiled.unseen.map((name) => (
        <p key={name} className="trouble">
          {name}: the building shows no such landmark; no robot will find it.
        </p>
      ))}
      {compiled.notes.map((note) => (
        <p key={note}>Note: {note}.</p>
      ))}
      <p className="quiet">
        Assumed: {brief(rates.hash_core)} hashes/s on a core, {brief(rates.hash_gpu)} on a GPU; {brief(rates.kdf_core)}{" "}
        slow hashes/s (N = 2^12, r = 8) on a core, {brief(rates.kdf_gpu)} on a GPU.
      </p>
    </section>
  );
}
