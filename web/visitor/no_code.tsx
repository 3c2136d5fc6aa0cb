// Without an invitation: what to do, and two ways to bring one along by hand.

import { type SubmitEvent, useId, useState } from "react";
import { DEFAULT_ROOT } from "../client";
import { type Found, readLink, readTyped } from "./invitation_store";

interface Props {
  readonly problem: string | undefined;
  readonly onFound: (found: Found) => void;
}

export function NoCode({ problem, onFound }: Props) {
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
      <form className="panel" onSubmit={submitLink}>
        <label htmlFor={`${id}link`}>Or paste the link from under the code</label>
        <div className="row">
          <input
            id={`${id}link`}
            data-testid="link"
            type="text"
            inputMode="url"
            autoComplete="off"
            autoCapitalize="none"
            spellCheck={false}
            placeholder="http://…#v=1&pin=…"
            value={link}
            onChange={(event) => setLink(event.target.value)}
          />
          <button type="submit" className="primary" data-testid="link-join" disabled={link.trim() === ""}>
            Join
          </button>
        </div>
      </form>
      <details className="panel">
        <summary>Type the pin instead</summary>
        <form className="fields" onSubmit={submitTyped}>
          <label htmlFor={`${id}pin`}>Pin</label>
          <input
            id={`${id}pin`}
            data-testid="pin"
            type="text"
            inputMode="numeric"
            autoComplete="off"
            value={pin}
            onChange={(event) => setPin(event.target.value)}
          />
          <label htmlFor={`${id}broker`}>Broker</label>
          <input
            id={`${id}broker`}
            data-testid="broker"
            type="text"
            inputMode="url"
            autoComplete="off"
            autoCapitalize="none"
            spellCheck={false}
            placeholder="ws://192.168.1.7:9001/mqtt"
            value={broker}
            onChange={(event) => setBroker(event.target.value)}
          />
          <div className="row">
            <div className="grow">
              <label htmlFor={`${id}root`}>Topic root</label>
              <input
                id={`${id}root`}
                data-testid="root"
                type="text"
                autoCapitalize="none"
                spellCheck={false}
                value={root}
                onChange={(event) => setRoot(event.target.value)}
              />
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
              <label htmlFor={`${id}user`}>Name</label>
              <input
                id={`${id}user`}
                data-testid="user"
                type="text"
                autoComplete="off"
                autoCapitalize="none"
                spellCheck={false}
                value={user}
                onChange={(event) => setUser(event.target.value)}
              />
            </div>
            <div className="grow">
              <label htmlFor={`${id}password`}>Password</label>
              <input
                id={`${id}password`}
                data-testid="password"
                type="password"
                autoComplete="off"
                value={password}
                onChange={(event) => setPassword(event.target.value)}
              />
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
