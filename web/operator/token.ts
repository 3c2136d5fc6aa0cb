// The operator's token. It comes in the fragment of the link printed in the terminal, which browsers never send, and it
// leaves the address bar at once: that bar is on the projector. Only this file and poll.ts hold it; nothing shows it.

const KEY = "phalanx-operator-token";
const WORD = /^[0-9A-Za-z_.~-]{1,512}$/;

/**
 * The token from the address bar, which is cleaned, or else the one that this tab kept from before.
 *
 * @returns undefined if there is none.
 */
export function takeToken(): string | undefined {
  const given = new URLSearchParams(window.location.hash.slice(1)).get("token");
  if (given !== null) {
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
    // A word that could not stand in a header is no token of ours; fetch() would refuse it with an exception.
    if (WORD.test(given)) {
      keep(given);
      return given;
    }
  }
  return kept();
}

/** After a refusal: a token that did not fit will not fit after a reload either. */
export function dropToken(): void {
  try {
    window.sessionStorage.removeItem(KEY);
  } catch {
    // Storage is forbidden here, so nothing was kept.
  }
}

function keep(token: string): void {
  try {
    window.sessionStorage.setItem(KEY, token);
  } catch {
    // Storage is forbidden here: the page works until it is reloaded.
  }
}

function kept(): string | undefined {
  try {
    return window.sessionStorage.getItem(KEY) ?? undefined;
  } catch {
    return undefined;
  }
}
