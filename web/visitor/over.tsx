// Shown instead of the map while a session waits for approval, or after it has ended.

import type { OverReason } from "../client";
import { Mixed, visitor as texts } from "../texts";
import { overWords } from "./visit_words";

export function WaitingForApproval({ name }: { readonly name: string }) {
  return (
    <main className="no-code" data-testid="waiting">
      <h1>{texts.waitForTheOperator}</h1>
      <p className="lead" role="status">
        {name === "" ? texts.letsYouIn : <Mixed parts={texts.letsYouInAs(<strong>{name}</strong>)} />}
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
        {texts.enterACode}
      </button>
    </main>
  );
}
