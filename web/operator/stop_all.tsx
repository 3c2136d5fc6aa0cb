// The emergency stop: always visible, and independent of all other state of this page.

import { useEffect, useState } from "react";
import { operator as texts } from "../texts";
import type { Station } from "./station";

interface Props {
  readonly station: Station;
  /** Whether all robots are stopped, as the gateway reports. */
  readonly held: boolean;
  /** When the gateway answered last, milliseconds on this page's monotonic clock. */
  readonly heardAt_ms: number;
}

/** An error stays visible for this long, if the gateway answers meanwhile. */
const SAID_FOR_MS = 5000;

export function StopAll({ station, held, heardAt_ms }: Props) {
  const [trouble, setTrouble] = useState<{ readonly text: string; readonly at_ms: number }>();
  const say = async (what: "stop" | "go") => {
    const text = await station.hold(what === "stop");
    setTrouble(text === undefined ? undefined : { text, at_ms: performance.now() });
  };
  useEffect(() => {
    if (trouble && heardAt_ms - trouble.at_ms > SAID_FOR_MS) setTrouble(undefined);
  }, [trouble, heardAt_ms]);

  return (
    <div className="stop-all" data-held={held}>
      {(held || trouble) && (
        <div className="stop-said">
          {held && (
            <>
              <strong role="status">{texts.allStopped}</strong>
              <button type="button" data-testid="let-go" onClick={() => void say("go")}>
                {texts.letThemGo}
              </button>
            </>
          )}
          {trouble && <strong role="alert">{texts.useTheTerminal(trouble.text)}</strong>}
        </div>
      )}
      <button type="button" className="stop" data-testid="stop-all" onClick={() => void say("stop")}>
        {texts.stopAll}
      </button>
    </div>
  );
}
