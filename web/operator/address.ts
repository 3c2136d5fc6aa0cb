// Parts of the page with their own fragments: the browser's back button closes them, and links open them.

import { useCallback, useEffect, useState } from "react";

/** Return whether the address ends with this fragment, and a function that sets or clears it. */
export function useFragment(fragment: string): readonly [boolean, (on: boolean) => void] {
  const [on, setOn] = useState(() => window.location.hash === fragment);
  useEffect(() => {
    const look = () => setOn(window.location.hash === fragment);
    look();
    window.addEventListener("hashchange", look);
    return () => window.removeEventListener("hashchange", look);
  }, [fragment]);
  const set = useCallback(
    (wanted: boolean) => {
      window.location.hash = wanted ? fragment : "";
    },
    [fragment],
  );
  return [on, set];
}
