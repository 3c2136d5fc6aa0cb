// Join a session: a nickname and, for visitors without a camera, the room code.

import { type SubmitEvent, useId, useState } from "react";
import { BadInvitation, parseRoomCode, type Secret } from "../client";
import { visitor as texts } from "../texts";
import { keepNickname, lastNickname, madeUp, NICKNAME_MAX } from "./nickname";

interface NicknameProps {
  readonly name: string;
  readonly onName: (name: string) => void;
}

/** Prefilled, so that one tap is enough. */
export function useNickname(storage: Storage | undefined): readonly [string, (name: string) => void, () => string] {
  const [name, setName] = useState(() => lastNickname(storage) || madeUp(Math.random()));
  function take(): string {
    const trimmed = name.trim();
    keepNickname(storage, trimmed);
    return trimmed;
  }
  return [name, setName, take];
}

function Nickname({ name, onName }: NicknameProps) {
  const id = useId();
  return (
    <>
      <label htmlFor={id}>{texts.yourName}</label>
      <input
        id={id}
        data-testid="nickname"
        type="text"
        autoComplete="nickname"
        maxLength={NICKNAME_MAX}
        value={name}
        onChange={(event) => onName(event.target.value)}
      />
    </>
  );
}

/** After a code was scanned. */
export function Join({ storage, onJoin }: { readonly storage: Storage | undefined; readonly onJoin: (name: string) => void }) {
  const [name, setName, takeName] = useNickname(storage);
  return (
    <main className="no-code">
      <h1>{texts.joinTheSwarm}</h1>
      <form
        className="panel fields"
        onSubmit={(event: SubmitEvent) => {
          event.preventDefault();
          onJoin(takeName());
        }}
      >
        <Nickname name={name} onName={setName} />
        <button type="submit" className="primary" data-testid="join">
          {texts.join}
        </button>
      </form>
      <p className="lead small">{texts.whatTheOperatorSees}</p>
    </main>
  );
}

interface RoomProps {
  readonly storage: Storage | undefined;
  readonly onRoom: (secret: Secret, name: string) => Promise<string | undefined>;
}

/** Eight digits from the screen. */
export function RoomCode({ storage, onRoom }: RoomProps) {
  const id = useId();
  const [name, setName, takeName] = useNickname(storage);
  const [typed, setTyped] = useState("");
  const [problem, setProblem] = useState<string>();
  const [isBusy, setBusy] = useState(false);

  async function submit(event: SubmitEvent) {
    event.preventDefault();
    let secret: Secret;
    try {
      secret = parseRoomCode(typed);
    } catch (error) {
      if (!(error instanceof BadInvitation)) throw error;
      setProblem(texts.roomCodeHasDigits);
      return;
    }
    setBusy(true);
    setProblem(await onRoom(secret, takeName()));
    setBusy(false);
  }

  return (
    <form className="panel fields" onSubmit={submit}>
      <label htmlFor={id}>{texts.roomCode}</label>
      <input
        id={id}
        data-testid="room-code"
        className="digits"
        type="text"
        inputMode="numeric"
        autoComplete="off"
        placeholder="1234 5678"
        maxLength={12}
        value={typed}
        onChange={(event) => setTyped(event.target.value)}
      />
      <Nickname name={name} onName={setName} />
      {problem !== undefined && (
        <p className="problem" role="alert">
          {problem}
        </p>
      )}
      <button type="submit" className="primary" data-testid="room-join" disabled={isBusy || typed.trim() === ""}>
        {texts.join}
      </button>
    </form>
  );
}
