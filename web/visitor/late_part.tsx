// Parts of the page that are loaded when they are needed.

import { type ComponentType, type ReactNode, useEffect, useState } from "react";

const LOAD_AGAIN_MS = 2000;

/**
 * Return a component that loads another one when it is first shown, and shows `waiting` until that has arrived.
 *
 * @param load is called again as long as it fails: a bad network.
 */
export function latePart<P extends object>(
  load: () => Promise<ComponentType<P>>,
  waiting: () => ReactNode,
): ComponentType<P> {
  return function LatePart(props: P) {
    const [Part, setPart] = useState<ComponentType<P>>();
    useEffect(() => {
      let isOver = false;
      let again: ReturnType<typeof setTimeout> | undefined;
      const tryLoading = () => {
        load().then(
          (part) => !isOver && setPart(() => part),
          () => {
            if (!isOver) again = setTimeout(tryLoading, LOAD_AGAIN_MS);
          },
        );
      };
      tryLoading();
      return () => {
        isOver = true;
        clearTimeout(again);
      };
    }, []);
    return Part ? <Part {...props} /> : waiting();
  };
}
