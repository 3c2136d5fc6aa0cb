// A node's actions and conditions: the fields of the file that have no place on the map.

import { operator as texts } from "../../texts";
import type { DraftNode, Edit, Words } from "./draft";

const WORDS = ["within_m", "timeout_s", "do", "wait", "send"] as const;
type Word = (typeof WORDS)[number];

export function NodeWords({ node, edit }: { readonly node: DraftNode; readonly edit: (edit: Edit) => void }) {
  return (
    <div className="fields words">
      {WORDS.map((word) => {
        const shown = shownWord(node.words[word]);
        return (
          <label key={word}>
            {texts.nodeWords[word]}
            <input
              // Undo can change the value.
              key={shown}
              data-testid={`word-${word}`}
              defaultValue={shown}
              maxLength={200}
              onBlur={({ currentTarget: { value } }) => {
                if (value.trim() !== shown) edit({ kind: "word", name: node.name, word, value: readWord(word, value) });
              }}
              onKeyDown={(event) => {
                if (event.key === "Enter") event.currentTarget.blur();
              }}
            />
          </label>
        );
      })}
    </div>
  );
}

/** Values as they are typed: `1.5`, `pick shelf=3`, `door open, go`. */
export function shownWord(value: unknown): string {
  if (Array.isArray(value)) return value.join(", ");
  if (typeof value === "string" || typeof value === "number") return String(value);
  const [name, args] = Object.entries((value ?? {}) as Record<string, Words | null>)[0] ?? ["", {}];
  return [name, ...Object.entries(args ?? {}).map(([key, each]) => `${key}=${String(each)}`)].join(" ");
}

/** The value of a typed field; invalid input is left for the compiler to report. */
export function readWord(word: Word, typed: string): unknown {
  const text = typed.trim();
  if (text === "") return undefined;
  if (word === "within_m" || word === "timeout_s") return numberOr(text);
  if (word !== "do") return text.split(/\s*,\s*/).filter((name) => name !== "");
  const [name = "", ...args] = text.split(/\s+(?=[^\s=]+=)/);
  if (args.length === 0) return name;
  const parts = args.map((arg) => [arg, arg.indexOf("=")] as const);
  return { [name]: Object.fromEntries(parts.map(([arg, at]) => [arg.slice(0, at), numberOr(arg.slice(at + 1))])) };
}

function numberOr(text: string): number | string {
  const value = Number(text);
  return text !== "" && Number.isFinite(value) ? value : text;
}
