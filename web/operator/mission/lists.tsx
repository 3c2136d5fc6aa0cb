// The mission as lists, with all functions of the map, for keyboards and screen readers.

import { useState } from "react";
import { operator as texts } from "../../texts";
import { type Draft, type DraftNode, type Edit, nodeOf, type Site } from "./draft";
import { NodeWords } from "./node_words";

interface Props {
  readonly draft: Draft;
  readonly sites: readonly Site[];
  readonly picked: string | undefined;
  readonly onPick: (name: string) => void;
  readonly edit: (edit: Edit) => void;
}

export function Landmarks({ draft, sites, picked, onPick, edit }: Props) {
  const [chosen, setChosen] = useState(0);
  const free = sites.flatMap((site, i) => (nodeOf(draft, site) ? [] : [[i, site] as const]));
  const site = free.find(([i]) => i === chosen)?.[1] ?? free[0]?.[1];
  return (
    <section className="card" aria-labelledby="landmarks-title">
      <header>
        <h2 id="landmarks-title">
          {texts.landmarks} <span className="count">{draft.nodes.length}</span>
        </h2>
      </header>
      <div className="fields">
        <label>
          {texts.theBuildings}
          <select data-testid="site" value={free.find(([, each]) => each === site)?.[0] ?? ""} onChange={(event) => setChosen(Number(event.target.value))}>
            {free.map(([i, each]) => (
              <option key={i} value={i}>
                {texts.kindAt(texts.kinds[each.type] ?? each.type, each.at[0].toFixed(1), each.at[1].toFixed(1))}
              </option>
            ))}
          </select>
        </label>
        <button type="button" data-testid="add-site" disabled={!site} onClick={() => site && edit({ kind: "site", site })}>
          {texts.add}
        </button>
      </div>
      <ul data-testid="nodes">
        {draft.nodes.map((node) => (
          <NodeRow key={node.name} node={node} picked={node.name === picked} onPick={onPick} edit={edit} />
        ))}
      </ul>
    </section>
  );
}

interface RowProps {
  readonly node: DraftNode;
  readonly picked: boolean;
  readonly onPick: (name: string) => void;
  readonly edit: (edit: Edit) => void;
}

function NodeRow({ node, picked, onPick, edit }: RowProps) {
  const { name, start, final } = node;
  const [typed, setTyped] = useState(name);
  const rename = () => {
    edit({ kind: "rename", name, to: typed });
    // An empty or duplicate name is rejected.
    setTyped(name);
  };
  return (
    <li data-picked={picked}>
      <input
        aria-label={texts.nameOf(name)}
        value={typed}
        maxLength={60}
        onFocus={() => onPick(name)}
        onChange={(event) => setTyped(event.target.value)}
        onBlur={rename}
        onKeyDown={(event) => {
          if (event.key === "Enter") event.currentTarget.blur();
        }}
      />
      <button type="button" aria-pressed={start} aria-label={texts.isAStart(name)} onClick={() => edit({ kind: "start", name })}>
        {texts.start}
      </button>
      <button type="button" aria-pressed={final} aria-label={texts.isFinal(name)} onClick={() => edit({ kind: "final", name })}>
        {texts.final}
      </button>
      <button type="button" className="remove" aria-label={texts.removeName(name)} onClick={() => edit({ kind: "remove", name })}>
        ✕
      </button>
      {picked && <NodeWords node={node} edit={edit} />}
    </li>
  );
}

export function Ways({ draft, edit }: Pick<Props, "draft" | "edit">) {
  const names = draft.nodes.map(({ name }) => name);
  const [from, setFrom] = useState("");
  const [to, setTo] = useState("");
  // The chosen node may have been renamed or removed.
  const a = names.includes(from) ? from : (names[0] ?? "");
  const b = names.includes(to) ? to : (names[1] ?? "");
  return (
    <section className="card" aria-labelledby="ways-title">
      <header>
        <h2 id="ways-title">
          {texts.ways} <span className="count">{draft.ways.length}</span>
        </h2>
      </header>
      <div className="fields">
        <label>
          {texts.from}
          <select data-testid="way-from" value={a} onChange={(event) => setFrom(event.target.value)}>
            {names.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
        <label>
          {texts.to}
          <select data-testid="way-to" value={b} onChange={(event) => setTo(event.target.value)}>
            {names.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
        <button type="button" data-testid="connect" disabled={a === b} onClick={() => edit({ kind: "connect", from: a, to: b })}>
          {texts.connect}
        </button>
      </div>
      <ul data-testid="ways">
        {draft.ways.map((way, i) => {
          const words = `${way.from} ${way.both ? "↔" : "→"} ${way.to}`;
          return (
            <li key={i}>
              <span className="wrap">{words}</span>
              <button type="button" aria-label={texts.turnTheWay(words)} onClick={() => edit({ kind: "turn", way })}>
                {texts.turn}
              </button>
              <button
                type="button"
                className="remove"
                aria-label={texts.removeTheWay(words)}
                onClick={() => edit({ kind: "disconnect", way })}
              >
                ✕
              </button>
            </li>
          );
        })}
      </ul>
    </section>
  );
}
