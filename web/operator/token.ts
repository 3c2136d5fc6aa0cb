// The operator's token. It is in the fragment of the link printed in the terminal, which browsers never send, and is removed
// from the address bar at once, as that is projected. Only this file and poll.ts access it; nothing displays it.

const KEY = "phalanx-operator-token";
const WORD = /^[0-9A-Za-z_.~-]{1,512}$/;

/**
 * Return the token from the address bar, which is removed there, or the one that this tab stored.
 *
 * @returns undefined if there is none.
 */
export function takeToken(): string | undefined {
  const given = new URLSearchParams(window.location.hash.slice(1)).get("token");
  if (given !== null) {
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
    // An invalid token cannot be sent in a header: fetch() would throw.
    if (WORD.test(given)) {
      keep(given);
      return given;
    }
  }
  return kept();
}

/** Forget a refused token, which would also fail after a reload. */
export function dropToken(): void {
  try {
    window.sessionStorage.removeItem(KEY);
  } catch {
    // Storage is forbidden, so nothing was stored.
  }
}

function keep(token: string): void {
  try {
    window.sessionStorage.setItem(KEY, token);
  } catch {
    // Storage is forbidden: the page works until reloaded.
  }
}

function kept(): string | undefined {
  try {
    return window.sessionStorage.getItem(KEY) ?? undefined;
  } catch {
    return undefined;
  }
}
