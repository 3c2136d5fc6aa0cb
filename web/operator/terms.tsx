// Words that are not plain, and what they mean: shown to a pointer, a finger or the keyboard's focus.

import { type ReactNode, useEffect, useState } from "react";

export const TERMS = {
  mode: "How visitors get in. session: the code admits them, and then each has keys of its own. qrkey: all share the code's key, so nobody can be removed.",
  code: "It holds a secret that admits newcomers. It changes by itself from time to time; the one before it works for two minutes more.",
  newCode: "The code before is refused at once, also where somebody has scanned it and not joined yet. Who is here stays.",
  sharedCode: "Changes the code at once. Nobody is logged out: phones that are in get the new one. Mode qrkey can remove nobody.",
  room: "For people without a camera: they open the address and type these digits. Each room code admits one visitor, then another one is shown. When strangers have used up its 120 tries, hide it and show a new one.",
  session: "Everybody who has joined. Who is away can come back with the same name and role for eight hours, or one hour on plain http.",
  role: "watch: sees everything. drive: commands robots as well. operate: may do what this page does.",
  assigned: "The robot that a visitor drives, or was given. A robot that you give stays until you take it. Choose a robot of another visitor to exchange the two.",
  door: "While the door is closed, newcomers wait until you let them in. Removing somebody closes it, as the same person can scan the new code. Who waits when you open it still needs your approval.",
  everybodyOut: "Ends all sessions for good, changes the code and closes the door. Tickets stay valid.",
  remove: "Ends this session at once and for good, makes its ticket invalid, changes the code and closes the door. The same person can come back as a newcomer if you let them in.",
  broker: "The program in the network that passes messages between phones and the gateway.",
  visitors: "Visitors of mode qrkey, who share one key: pages and programs that asked for something lately, by a name that each makes up. One that asks for nothing any longer disappears after two and a half minutes.",
  compromise: "Let a robot behave as if somebody had broken into its computer, to see the others find out.",
  attack: "What the robot does from then on.",
  trusted: "Two small computers on each robot that nobody can change: they write down what it sees and does, and stop it when no neighbour vouches for it any longer.",
  audits: "Neighbours check what a robot wrote down by doing the same sums. Whoever cannot explain what it did gets no voucher.",
  fleet: "All robots that the gateway knows.",
  led: "The colour of the robot's light.",
  drive: "manual: standing. driven by: the visitors whose joysticks drive it now, each by the last signs of its name in the list of visitors. route: on its way to points that a visitor tapped. mission: goes where what it finds tells it.",
  heard: "How long ago the robot was last heard.",
  link: "ok: heard within 5 s. quiet: within a minute. lost: not for a minute.",
  shield: "How many neighbours vouch for the robot, of how many it needs; and for how long it may go on if none does so anew. Without, it stops: Safe Mode.",
  safeMode: "Stopped by its trusted nodes, as too few neighbours vouched for it. It obeys nobody until the gateway is started again.",
  mission: "How far the robot is with its encoded mission: how many of its instructions it could decode by reaching the places that they describe. Below, what it has learnt from landmarks that its wheels count wrong.",
  messages: "What went through the gateway since it was started.",
  refused: "Messages that were thrown away: broken, too old, sent twice, or not sealed with the code.",
} as const;

export function Term({ of, children }: { readonly of: keyof typeof TERMS; readonly children: ReactNode }) {
  return (
    <span className="term" tabIndex={0} data-tip={TERMS[of]} aria-description={TERMS[of]}>
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

/** Once on the page: the box in which meanings appear. */
export function Tip() {
  const [shown, setShown] = useState<Shown>();

  useEffect(() => {
    const show = (event: Event) => {
      const under = event.target instanceof Element ? event.target.closest("[data-tip]") : null;
      // A pointer that rests while the page scrolls below it does not take away what the keyboard asked for.
      const term = under ?? document.activeElement?.closest("[data-tip]");
      setShown(term ? below(term) : undefined);
    };
    // The focus itself may scroll its word into view.
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
  // Read out as the word's own description, so not a second time here.
  return (
    <div className="tip" role="tooltip" aria-hidden="true" style={{ left: shown.left, top: shown.top }}>
      {shown.text}
    </div>
  );
}
