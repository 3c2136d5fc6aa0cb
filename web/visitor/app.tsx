// The page: with an invitation it drives the swarm, without one it says how to get one.

import { useCallback, useEffect, useState } from "react";
import { type Pin, useLink } from "../client";
import { Badge } from "./badge";
import { Cockpit } from "./cockpit";
import { type Found, forget, keep, type Surroundings, takeFromAddress, takeKept } from "./invitation_store";
import { NoCode } from "./no_code";

const browser: Surroundings = { location: window.location, history: window.history, storage: sessionStorageOrNone() };

export function App() {
  const [found, setFound] = useState<Found>(() => join(takeFromAddress(browser) ?? takeKept(browser)));
  const { to, problem } = found;
  const onMoved = useCallback(
    (pin: Pin) => {
      if (to) keep(browser, to, pin);
    },
    [to],
  );
  const link = useLink(to, onMoved);

  useEffect(() => {
    // Scanning again in the same tab changes nothing but the fragment.
    const onHash = () => {
      const taken = takeFromAddress(browser);
      if (taken?.to) join(taken);
      // A bad link does not take away the swarm that the visitor is driving.
      if (taken) setFound((now) => (taken.to || !now.to ? taken : now));
    };
    window.addEventListener("hashchange", onHash);
    return () => window.removeEventListener("hashchange", onHash);
  }, []);

  function leave() {
    forget(browser);
    setFound({});
  }

  return (
    <div className="page">
      {to ? (
        <Cockpit to={to} link={link} onLeave={leave} />
      ) : (
        <>
          <header className="top">
            <p className="brand">Phalanx</p>
            <div className="status">
              <Badge state="nocode" text="No code yet" />
            </div>
          </header>
          <NoCode problem={problem} onFound={(taken) => setFound(join(taken))} />
        </>
      )}
    </div>
  );
}

function join(found: Found): Found {
  if (found.to) keep(browser, found.to);
  return found;
}

function sessionStorageOrNone(): Storage | undefined {
  try {
    return window.sessionStorage;
  } catch {
    // Reading the property throws where site data is forbidden.
    return undefined;
  }
}
