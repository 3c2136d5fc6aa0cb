// A page without map and controls: a badge above, and what to read or to do below.

import type { ReactNode } from "react";
import { common } from "../texts";
import { Badge, type BadgeState } from "./badge";

interface Props {
  readonly state: BadgeState;
  readonly text: string;
  readonly children?: ReactNode;
}

export function Frame({ state, text, children }: Props) {
  return (
    <div className="page">
      <header className="top">
        <p className="brand">{common.brand}</p>
        <div className="status">
          <Badge state={state} text={text} />
        </div>
      </header>
      {children}
    </div>
  );
}
