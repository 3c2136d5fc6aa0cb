// A session from its first connection to its end: the cockpit, the wait for approval, or why it is over.
//
// Loaded while the visitor reads how to join: cryptography, map and controls are two thirds of the script.

import { useEffect, useMemo } from "react";
import { type SessionTo, useLink, useSwarm, type WebsocketWay } from "../client";
import { visitor as texts } from "../texts";
import { hostOf } from "./badge";
import { Cockpit } from "./cockpit";
import { Frame } from "./frame";
import { openSession } from "./open_link";
import { Over, WaitingForApproval } from "./over";
import { resumeStore } from "./resumes";

interface Props {
  readonly to: SessionTo;
  /** A websocket that was opened beside the loading of this file. */
  readonly way: WebsocketWay | undefined;
  /** The code has admitted this visitor, or was refused: it admits nobody again, and a reload resumes. */
  readonly onUsed: () => void;
  /** The swarm refused the code. */
  readonly onRefused: () => void;
  readonly onLeave: () => void;
}

export function Visit({ to, way, onUsed, onRefused, onLeave }: Props) {
  const open = useMemo(() => () => openSession(to, way), [to, way]);
  const link = useLink(open);
  const stage = useSwarm(link, ({ visit }) => visit.stage);
  const over = useSwarm(link, ({ visit }) => visit.over);
  const isWaiting = useSwarm(link, ({ visit }) => visit.standing?.waiting === true);
  const name = useSwarm(link, ({ visit }) => visit.name);

  useEffect(() => {
    if (stage === "here" || over === "code") onUsed();
    if (over === "code") onRefused();
  }, [stage, over, onUsed, onRefused]);

  function leave() {
    resumeStore.forget(to.fixed);
    onLeave();
  }

  if (over !== undefined)
    return (
      <Frame state="over" text={texts.sessionEnded}>
        {over !== "code" && <Over reason={over} onAgain={() => link?.transport.again()} onLeave={leave} />}
      </Frame>
    );
  if (isWaiting)
    return (
      <Frame state="waiting" text={texts.waitingForTheOperator}>
        <WaitingForApproval name={name} />
      </Frame>
    );
  const { broker } = to.at;
  const where =
    broker !== "" ? { via: "broker" as const, host: hostOf(broker) } : { via: "direct" as const, host: hostOf(to.url) };
  return <Cockpit where={where} link={link} onLeave={leave} />;
}
