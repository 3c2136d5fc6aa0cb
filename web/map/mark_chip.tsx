// A robot's mark beside its name, as on the map.

import { markOf } from "./marks";

export function MarkChip({ number }: { readonly number: number | undefined }) {
  if (number === undefined) return null;
  const { colour, ink, pattern } = markOf(number);
  return (
    <svg className="mark-chip" viewBox="-1.15 -1.15 2.3 2.3" aria-hidden="true" data-mark={number}>
      <circle r="1" fill={colour} />
      <path d={pattern} fill={ink} fillRule="evenodd" />
      <circle className="mark-edge" r="1.05" />
    </svg>
  );
}
