// Instead of the map: a session that waits for approval, or has ended.

import type { OverReason } from "../client";
import { overWords } from "./visit_words";

export function WaitingForApproval({ name }: { readonly name: string }) {
  return (
    <main className="no-code" data-testid="waiting">
      <h1>Wait for the operator</h1>
      <p className="lead" role="status">
        The operator has to let you in{name && <> as <strong>{name}</strong></>}. This page goes on by itself.
      </p>
    </main>
  );
}

interface Props {
  readonly reason: OverReason;
  readonly onAgain: () => void;
  readonly onLeave: () => void;
}

export function Over({ reason, onAgain, onLeave }: Props) {
  const { title, text, again } = overWords(reason);
  return (
    <main className="no-code" data-testid="over" data-reason={reason}>
      <h1>{title}</h1>
      <p className="lead" role="alert">
        {text}
      </p>
      {again !== undefined && (
        <button type="button" className="primary" data-testid="again" onClick={onAgain}>
          {again}
        </button>
      )}
      <button type="button" data-testid="leave" onClick={onLeave}>
        Enter a code
      </button>
    </main>
  );
}
