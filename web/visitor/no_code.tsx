// Without an invitation: instructions, and two ways to enter one by hand.

import { type SubmitEvent, useId, useState } from "react";
import type { Secret } from "../client";
import { visitor as texts } from "../texts";
import { type Found, readLink } from "./invitation_store";
import { RoomCode } from "./join";

interface Props {
  readonly problem: string | undefined;
  readonly storage: Storage | undefined;
  readonly onRoom: (secret: Secret, name: string) => Promise<string | undefined>;
  readonly onFound: (found: Found) => void;
}

export function NoCode({ problem, storage, onRoom, onFound }: Props) {
  const id = useId();
  const [link, setLink] = useState("");

  function submitLink(event: SubmitEvent) {
    event.preventDefault();
    onFound(readLink(link));
  }

  return (
    <main className="no-code">
      <svg className="no-code-picture" viewBox="0 0 96 96" aria-hidden="true">
        <path d="M8 30V14a6 6 0 0 1 6-6h16M66 8h16a6 6 0 0 1 6 6v16M88 66v16a6 6 0 0 1-6 6H66M30 88H14a6 6 0 0 1-6-6V66" />
        <circle cx="48" cy="33" r="8" />
        <circle cx="33" cy="59" r="8" />
        <circle cx="63" cy="59" r="8" />
      </svg>
      <h1>{texts.scanTheCode}</h1>
      <p className="lead">{texts.howToScan}</p>
      {problem && (
        <p className="problem" role="alert">
          {texts.didNotWork(problem)}
        </p>
      )}
      <RoomCode storage={storage} onRoom={onRoom} />
      <form className="panel" onSubmit={submitLink}>
        <label htmlFor={id}>{texts.pasteTheLink}</label>
        <div className="row">
          <input
            id={id}
            data-testid="link"
            type="text"
            inputMode="url"
            placeholder="http://…#j=…"
            autoComplete="off"
            autoCapitalize="none"
            spellCheck={false}
            value={link}
            onChange={(event) => setLink(event.target.value)}
          />
          <button type="submit" className="primary" data-testid="link-join" disabled={link.trim() === ""}>
            {texts.join}
          </button>
        </div>
      </form>
    </main>
  );
}
