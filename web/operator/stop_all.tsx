// The emergency stop: always in sight, and never waiting for anything that this page knows or does not know.

import { useState } from "react";
import { order } from "./orders";

interface Props {
  readonly token: string;
  /** Whether the gateway says that all robots are stopped. */
  readonly held: boolean;
}

export function StopAll({ token, held }: Props) {
  const [trouble, setTrouble] = useState<string>();
  const say = async (what: "stop" | "go") => setTrouble(await order(token, what));

  return (
    <div className="stop-all" data-held={held}>
      {held && (
        <>
          <strong role="status">All robots are stopped, whatever visitors do.</strong>
          <button type="button" data-testid="let-go" onClick={() => void say("go")}>
            Let them go
          </button>
        </>
      )}
      {trouble !== undefined && <strong role="alert">{trouble} Use the terminal, or the robots’ switches.</strong>}
      <button type="button" className="stop" data-testid="stop-all" onClick={() => void say("stop")}>
        Stop all robots
      </button>
    </div>
  );
}
