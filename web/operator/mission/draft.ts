// A mission being drawn: pure functions from draft to draft, and its YAML form.
//
// Fields that the editor has no button for (actions, messages, sensors, limits) are preserved.

export type Words = Readonly<Record<string, unknown>>;
export type Place = readonly [number, number];

export interface DraftNode {
  readonly name: string;
  readonly start: boolean;
  readonly final: boolean;
  /** All fields of the node in the file except `start` and `final`. */
  readonly words: Words;
  /** Where it is drawn, metres; undefined for nodes without a place. */
  readonly at: Place | undefined;
  /** Type of its landmark, or "". */
  readonly type: string;
}

export interface DraftWay {
  readonly from: string;
  readonly to: string;
  readonly both: boolean;
  readonly rest: Words;
}

export interface Draft {
  readonly name: string;
  readonly nodes: readonly DraftNode[];
  readonly ways: readonly DraftWay[];
  /** Other fields of the file: area, coding, … */
  readonly rest: Words;
}

/** A landmark of the building, and how it is observed. */
export interface Site {
  readonly type: string;
  readonly at: Place;
  readonly see: unknown;
  readonly width: number | undefined;
}

export interface History {
  readonly now: Draft;
  readonly past: readonly Draft[];
}

export type Edit =
  | { readonly kind: "load"; readonly draft: Draft }
  | { readonly kind: "title"; readonly name: string }
  | { readonly kind: "site"; readonly site: Site }
  | { readonly kind: "place"; readonly at: Place }
  | { readonly kind: "rename"; readonly name: string; readonly to: string }
  | { readonly kind: "remove"; readonly name: string }
  | { readonly kind: "start"; readonly name: string }
  | { readonly kind: "final"; readonly name: string }
  /** Undefined removes the field. */
  | { readonly kind: "word"; readonly name: string; readonly word: string; readonly value: unknown }
  | { readonly kind: "connect"; readonly from: string; readonly to: string }
  | { readonly kind: "turn"; readonly way: DraftWay }
  | { readonly kind: "disconnect"; readonly way: DraftWay }
  | { readonly kind: "undo" };

const MOST_UNDONE = 100;
/** Places within this distance are the same landmark, as they may be rounded. */
const SAME_M = 0.02;
const SHORT: Readonly<Record<string, string>> = {
  doorway: "door",
  concave_left: "corner",
  concave_right: "corner",
  corner_convex: "corner",
  room: "room",
  qr: "code",
};

/** A new mission that starts at the building's start. */
export function newDraft(bounds: readonly number[], start: Place | undefined): Draft {
  const here = start && {
    name: "start",
    start: true,
    final: false,
    words: { see: { position: start } },
    at: start,
    type: "",
  };
  return { name: "mission", nodes: here ? [here] : [], ways: [], rest: { area: bounds } };
}

export function historyReducer(history: History, edit: Edit): History {
  if (edit.kind === "undo") {
    const before = history.past.at(-1);
    return before ? { now: before, past: history.past.slice(0, -1) } : history;
  }
  const now = edited(history.now, edit);
  if (now === history.now) return history;
  // Typing a title is undone in one step.
  const past = edit.kind === "title" && history.now.nodes === history.past.at(-1)?.nodes ? history.past : [...history.past, history.now];
  return { now, past: past.slice(-MOST_UNDONE) };
}

function edited(draft: Draft, edit: Exclude<Edit, { readonly kind: "undo" }>): Draft {
  const { nodes, ways } = draft;
  switch (edit.kind) {
    case "load":
      return edit.draft;
    case "title":
      return { ...draft, name: edit.name };
    case "site": {
      const { site } = edit;
      if (nodeOf(draft, site)) return draft;
      const words = { see: site.see, ...(site.width !== undefined && { width: site.width }) };
      return withNode(draft, SHORT[site.type] ?? "landmark", words, site.at, site.type);
    }
    case "place":
      return withNode(draft, "place", { see: { position: edit.at } }, edit.at, "");
    case "rename": {
      const to = edit.to.trim();
      if (to === "" || nodes.some(({ name }) => name === to)) return draft;
      const swap = (name: string) => (name === edit.name ? to : name);
      return {
        ...draft,
        nodes: nodes.map((node) => ({ ...node, name: swap(node.name) })),
        ways: ways.map((way) => ({ ...way, from: swap(way.from), to: swap(way.to) })),
      };
    }
    case "remove":
      return {
        ...draft,
        nodes: nodes.filter(({ name }) => name !== edit.name),
        ways: ways.filter(({ from, to }) => from !== edit.name && to !== edit.name),
      };
    case "start":
    case "final":
      return {
        ...draft,
        nodes: nodes.map((node) => (node.name === edit.name ? { ...node, [edit.kind]: !node[edit.kind] } : node)),
      };
    case "word":
      return {
        ...draft,
        nodes: nodes.map((node) => {
          if (node.name !== edit.name) return node;
          const rest = Object.entries(node.words).filter(([word]) => word !== edit.word);
          return { ...node, words: Object.fromEntries(edit.value === undefined ? rest : [...rest, [edit.word, edit.value]]) };
        }),
      };
    case "connect": {
      const { from, to } = edit;
      const known = (name: string) => nodes.some((node) => node.name === name);
      if (from === to || !known(from) || !known(to) || wayBetween(draft, from, to)) return draft;
      return { ...draft, ways: [...ways, { from, to, both: true, rest: {} }] };
    }
    case "turn":
      return { ...draft, ways: ways.map((way) => (way === edit.way ? turned(draft, way) : way)) };
    case "disconnect":
      return { ...draft, ways: ways.filter((way) => way !== edit.way) };
  }
}

function withNode(draft: Draft, prefix: string, words: Words, at: Place, type: string): Draft {
  const names = new Set(draft.nodes.map(({ name }) => name));
  let count = 1;
  while (names.has(`${prefix}${count}`)) count += 1;
  const start = draft.nodes.every((node) => !node.start);
  return { ...draft, nodes: [...draft.nodes, { name: `${prefix}${count}`, start, final: false, words, at, type }] };
}

/** Both directions, then one, then the other. Paths with an action or a direction keep their ends. */
function turned({ nodes }: Draft, way: DraftWay): DraftWay {
  if (Object.keys(way.rest).length > 0) return { ...way, both: !way.both };
  const [earlier, later] = nodes.map(({ name }) => name).filter((name) => name === way.from || name === way.to);
  if (earlier === undefined || later === undefined) return way;
  if (way.both) return { ...way, from: earlier, to: later, both: false };
  return way.from === earlier ? { ...way, from: later, to: earlier } : { ...way, from: earlier, to: later, both: true };
}

/** The path between two nodes, in any direction. */
export function wayBetween(draft: Draft, a: string, b: string): DraftWay | undefined {
  return draft.ways.find(({ from, to }) => (from === a && to === b) || (from === b && to === a));
}

/** The node of a landmark of the building. */
export function nodeOf(draft: Draft, { at, type }: Site): DraftNode | undefined {
  return nearest(
    draft.nodes.filter((node) => node.type === type),
    at,
    SAME_M,
  );
}

/** The nearest of these, within reach (metres). */
export function nearest<T extends { readonly at: Place | undefined }>(
  things: readonly T[],
  [x, y]: Place,
  reach_m: number,
): T | undefined {
  let best: T | undefined;
  let bestAway = reach_m;
  for (const thing of things) {
    if (!thing.at) continue;
    const away = Math.hypot(thing.at[0] - x, thing.at[1] - y);
    if (away <= bestAway) {
      best = thing;
      bestAway = away;
    }
  }
  return best;
}

// --- as YAML ----------------------------------------------------------------------------------------------------------

/** Words of the file format need no quotes; others could mean yes, no or null in YAML. */
const PLAIN = new Set(
  (
    "mission map area roam repeatable coding nodes ways see do start final join chained within_m timeout_s send wait part " +
    "width doorway corner_convex concave_left concave_right room qr position sensor action time facing text token from to both direction"
  ).split(" "),
);

/** The mission as `phalanx mission build` reads it. */
export function toYaml({ name, nodes, ways, rest }: Draft): string {
  const lines = [`mission: ${flow(name)}`];
  for (const [key, value] of Object.entries(rest)) lines.push(`${keyed(key)}: ${flow(value)}`);
  lines.push(nodes.length === 0 ? "nodes: {}" : "nodes:");
  for (const { name: node, start, final, words } of nodes) {
    lines.push(`  ${JSON.stringify(node)}: ${flow({ ...(start && { start }), ...words, ...(final && { final }) })}`);
  }
  if (ways.length > 0) lines.push("ways:");
  for (const { from, to, both, rest: more } of ways) {
    lines.push(`  - ${flow({ from, to, ...(both && { both }), ...more })}`);
  }
  return `${lines.join("\n")}\n`;
}

function flow(value: unknown): string {
  if (typeof value === "number") return flowNumber(value);
  if (Array.isArray(value)) return `[${value.map(flow).join(", ")}]`;
  if (typeof value !== "object" || value === null) return JSON.stringify(value) ?? "null";
  return `{${Object.entries(value)
    .map(([key, each]) => `${keyed(key)}: ${flow(each)}`)
    .join(", ")}}`;
}

/** YAML parses 1e-7 as a string: floats need a point. */
function flowNumber(value: number): string {
  const text = String(value);
  return text.includes("e") && !text.includes(".") ? text.replace("e", ".0e") : text;
}

function keyed(key: string): string {
  return PLAIN.has(key) ? key : JSON.stringify(key);
}
