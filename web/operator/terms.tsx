// Explanations of terms, shown on hover, tap or keyboard focus.

import { type ReactNode, useEffect, useState } from "react";
import { operator as texts } from "../texts";

export function Term({ of, children }: { readonly of: keyof typeof texts.terms; readonly children: ReactNode }) {
  return (
    <span className="term" tabIndex={0} data-tip={texts.terms[of]} aria-description={texts.terms[of]}>
      {children}
    </span>
  );
}

interface Shown {
  readonly term: Element;
  readonly text: string;
  readonly left: number;
  readonly top: number;
}

const WIDTH_PX = 320;

function below(term: Element): Shown {
  const { left, bottom } = term.getBoundingClientRect();
  return {
    term,
    text: term.getAttribute("data-tip") ?? "",
    left: Math.max(8, Math.min(left, window.innerWidth - WIDTH_PX - 8)),
    top: bottom + 6,
  };
}

/** The tooltip that shows explanations; once per page. */
export function Tip() {
  const [shown, setShown] = useState<Shown>();

  useEffect(() => {
    const show = (event: Event) => {
      const under = event.target instanceof Element ? event.target.closest("[data-tip]") : null;
      // A resting pointer over scrolling content must not close a tooltip that keyboard focus opened.
      const term = under ?? document.activeElement?.closest("[data-tip]");
      setShown(term ? below(term) : undefined);
    };
    // Focusing can scroll the term into view.
    const follow = () => setShown((now) => now && below(now.term));
    const hide = () => setShown(undefined);
    const hideByKey = (event: KeyboardEvent) => {
      if (event.key === "Escape") hide();
    };
    document.addEventListener("pointerover", show);
    document.addEventListener("focusin", show);
    document.addEventListener("focusout", hide);
    document.addEventListener("keydown", hideByKey);
    document.addEventListener("scroll", follow, true);
    return () => {
      document.removeEventListener("pointerover", show);
      document.removeEventListener("focusin", show);
      document.removeEventListener("focusout", hide);
      document.removeEventListener("keydown", hideByKey);
      document.removeEventListener("scroll", follow, true);
    };
  }, []);

  if (!shown) return null;
  // Screen readers read it as the term's description, so it is hidden here.
  return (
    <div className="tip" role="tooltip" aria-hidden="true" style={{ left: shown.left, top: shown.top }}>
      {shown.text}
    </div>
  );
}
