// Without an invitation: what to do, and two ways to bring one along by hand.

import { type InputHTMLAttributes, type SubmitEvent, useId, useState } from "react";
import { DEFAULT_ROOT, type Secret } from "../client";
import { type Found, readLink, readTyped } from "./invitation_store";
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
  const [pin, setPin] = useState("");
  const [broker, setBroker] = useState("");
  const [root, setRoot] = useState(DEFAULT_ROOT);
  const [mqtt, setMqtt] = useState("5");
  const [user, setUser] = useState("");
  const [password, setPassword] = useState("");

  function submitLink(event: SubmitEvent) {
    event.preventDefault();
    onFound(readLink(link, root.trim()));
  }

  function submitTyped(event: SubmitEvent) {
    event.preventDefault();
    onFound(readTyped(pin, broker, root, mqtt, user, password));
  }

  return (
    <main className="no-code">
      <svg className="no-code-picture" viewBox="0 0 96 96" aria-hidden="true">
        <path d="M8 30V14a6 6 0 0 1 6-6h16M66 8h16a6 6 0 0 1 6 6v16M88 66v16a6 6 0 0 1-6 6H66M30 88H14a6 6 0 0 1-6-6V66" />
        <circle cx="48" cy="33" r="8" />
        <circle cx="33" cy="59" r="8" />
        <circle cx="63" cy="59" r="8" />
      </svg>
      <h1>Scan the QR code</h1>
      <p className="lead">
        Point your phone’s camera at the code on the operator’s screen. It opens this page and lets you drive the
        robots.
      </p>
      {problem && (
        <p className="problem" role="alert">
          That did not work: {problem}.
        </p>
      )}
      <RoomCode storage={storage} onRoom={onRoom} />
      <form className="panel" onSubmit={submitLink}>
        <label htmlFor={id}>Or paste the link from under the code</label>
        <div className="row">
          <Typed id={id} testid="link" inputMode="url" placeholder="http://…#j=…" value={link} onTyped={setLink} />
          <button type="submit" className="primary" data-testid="link-join" disabled={link.trim() === ""}>
            Join
          </button>
        </div>
      </form>
      <details className="panel">
        <summary>Type a broker’s pin instead</summary>
        <form className="fields" onSubmit={submitTyped}>
          <Field label="Pin" testid="pin" inputMode="numeric" value={pin} onTyped={setPin} />
          <Field label="Broker" testid="broker" inputMode="url" placeholder="ws://192.168.1.7:9001/mqtt" value={broker} onTyped={setBroker} />
          <div className="row">
            <div className="grow">
              <Field label="Topic root" testid="root" value={root} onTyped={setRoot} />
            </div>
            <div>
              <label htmlFor={`${id}mqtt`}>MQTT</label>
              <select id={`${id}mqtt`} value={mqtt} onChange={(event) => setMqtt(event.target.value)}>
                <option value="5">5</option>
                <option value="4">3.1.1</option>
              </select>
            </div>
          </div>
          <p className="hint">Only if the broker asks visitors for a login:</p>
          <div className="row">
            <div className="grow">
              <Field label="Name" testid="user" value={user} onTyped={setUser} />
            </div>
            <div className="grow">
              <Field label="Password" testid="password" type="password" value={password} onTyped={setPassword} />
            </div>
          </div>
          <button type="submit" className="primary" data-testid="typed-join">
            Join
          </button>
        </form>
      </details>
    </main>
  );
}

type Words = InputHTMLAttributes<HTMLInputElement> & { readonly testid: string; readonly onTyped: (words: string) => void };

/** Nothing that is typed here is prose, or to be remembered by the browser. */
function Typed({ testid, onTyped, ...more }: Words) {
  return (
    <input
      data-testid={testid}
      type="text"
      autoComplete="off"
      autoCapitalize="none"
      spellCheck={false}
      onChange={(event) => onTyped(event.target.value)}
      {...more}
    />
  );
}

function Field({ label, ...more }: Words & { readonly label: string }) {
  const id = useId();
  return (
    <>
      <label htmlFor={id}>{label}</label>
      <Typed id={id} {...more} />
    </>
  );
}
