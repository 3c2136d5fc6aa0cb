// The building, with its landmarks and the draft on it. Metres, y up; drawn with y down.

import type { PointerEvent } from "react";
import { operator as texts } from "../../texts";
import type { World } from "./desk";
import { type Draft, type DraftNode, nodeOf, type Place, type Site } from "./draft";

interface Props {
  readonly world: World;
  readonly draft: Draft;
  /** The node at which a path starts, or that was chosen in the list. */
  readonly picked: string | undefined;
  /** `reach_m`: tolerance of a tap. */
  readonly onTap: (at: Place, reach_m: number) => void;
}

const REACH_PX = 22;
const GLYPHS: Readonly<Record<string, string>> = {
  doorway: "M-.8 -.5H.8V.5H-.8Z",
  concave_left: "M0 -.8L.75 .6H-.75Z",
  concave_right: "M0 -.8L.75 .6H-.75Z",
  corner_convex: "M0 .8L.75 -.6H-.75Z",
  room: "M-.7 -.7H.7V.7H-.7Z",
  qr: "M0 -.85L.85 0L0 .85L-.85 0Z",
};
const ROUND = "M.75 0A.75 .75 0 1 1 -.75 0A.75 .75 0 1 1 .75 0Z";

export function EditorMap({ world, draft, picked, onTap }: Props) {
  const [x0, y0, x1, y1] = world.bounds;
  const [width, height] = [Math.max(x1 - x0, 0.1), Math.max(y1 - y0, 0.1)];
  const unit = Math.max(width, height) / 100;
  const edge = 3 * unit;
  const toDrawn = ([x, y]: Place): Place => [x - x0, y1 - y];
  const walls = world.walls.map(([ax, ay, bx, by]) => `M${ax - x0} ${y1 - ay}L${bx - x0} ${y1 - by}`).join("");
  const places = new Map(draft.nodes.flatMap(({ name, at }) => (at ? [[name, toDrawn(at)] as const] : [])));

  function onPointerUp(event: PointerEvent<SVGSVGElement>) {
    const matrix = event.currentTarget.getScreenCTM();
    if (!matrix) return;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    onTap([x0 + x, y1 - y], REACH_PX / matrix.a);
  }

  return (
    <svg
      className="editor-map"
      data-testid="editor-map"
      role="img"
      aria-label={texts.editorMap(world.name, world.sites.length, draft.nodes.length)}
      viewBox={`${-edge} ${-edge} ${width + 2 * edge} ${height + 2 * edge}`}
      onPointerUp={onPointerUp}
    >
      <path className="wall" d={walls} />
      {world.sites
        .filter((site) => !nodeOf(draft, site))
        .map((site, i) => (
          <Mark key={i} at={toDrawn(site.at)} type={site.type} size={1.15 * unit} />
        ))}
      {draft.ways.map((way, i) => (
        <Line key={i} from={places.get(way.from)} to={places.get(way.to)} both={way.both} unit={unit} />
      ))}
      {draft.nodes.map((node) => {
        const at = places.get(node.name);
        return at && <Chosen key={node.name} node={node} at={at} unit={unit} picked={node.name === picked} />;
      })}
    </svg>
  );
}

function Mark({ at, type, size }: { readonly at: Place; readonly type: Site["type"]; readonly size: number }) {
  return <path className="site" d={GLYPHS[type] ?? ROUND} transform={`translate(${at[0]} ${at[1]}) scale(${size})`} />;
}

function Line(props: {
  readonly from: Place | undefined;
  readonly to: Place | undefined;
  readonly both: boolean;
  readonly unit: number;
}) {
  const { from, to, both, unit } = props;
  if (!from || !to) return null;
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const angle = (Math.atan2(dy, dx) * 180) / Math.PI;
  const middle = `translate(${from[0] + 0.6 * dx} ${from[1] + 0.6 * dy}) rotate(${angle}) scale(${unit})`;
  return (
    <g className="way">
      <path d={`M${from[0]} ${from[1]}L${to[0]} ${to[1]}`} />
      {!both && <path className="arrow" d="M1.4 0L-1 -1.1V1.1Z" transform={middle} />}
    </g>
  );
}

interface ChosenProps {
  readonly node: DraftNode;
  readonly at: Place;
  readonly unit: number;
  readonly picked: boolean;
}

function Chosen({ node, at: [x, y], unit, picked }: ChosenProps) {
  return (
    <g className="node" data-node={node.name} data-picked={picked}>
      {(node.start || node.final) && <circle className={node.start ? "mark" : "mark final"} cx={x} cy={y} r={2.3 * unit} />}
      {node.start && node.final && <circle className="mark final" cx={x} cy={y} r={2.9 * unit} />}
      <path d={GLYPHS[node.type] ?? ROUND} transform={`translate(${x} ${y}) scale(${1.6 * unit})`} />
      <text x={x} y={y - 2.9 * unit} fontSize={3 * unit} strokeWidth={0.8 * unit}>
        {node.name}
      </text>
    </g>
  );
}
