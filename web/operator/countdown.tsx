// How long the code on the screen is still the newest one.

import { Mixed, operator as texts } from "../texts";
import { useNow } from "./clock";
import type { Sample } from "./poll";
import { clock } from "./words";
import { Term } from "./terms";

const RADIUS = 20;
const AROUND = 2 * Math.PI * RADIUS;

export function Countdown({ newest }: { readonly newest: Sample }) {
  const now = useNow(250);
  const { rotates_in_s, rotate_s, overlap_s, overlapping } = newest.state;
  const left_s = Math.max(0, rotates_in_s - (now - newest.at_ms) / 1000);
  const part = rotate_s > 0 ? Math.min(1, left_s / rotate_s) : 0;
  const old_left_s = overlap_s - (rotate_s - left_s);

  return (
    <div className="countdown" role="timer" aria-live="off" data-testid="countdown">
      <svg className="ring" viewBox="0 0 48 48" aria-hidden="true">
        <circle className="ring-track" cx="24" cy="24" r={RADIUS} />
        <circle
          className="ring-part"
          cx="24"
          cy="24"
          r={RADIUS}
          strokeDasharray={AROUND}
          strokeDashoffset={AROUND * (1 - part)}
        />
      </svg>
      <div>
        <p className="countdown-main">
          {left_s > 0 ? (
            <Mixed parts={texts.newCodeIn(<Term of="code">{texts.code}</Term>, <strong>{clock(left_s)}</strong>)} />
          ) : (
            texts.changingTheCode
          )}
        </p>
        <p className="quiet">
          {overlapping && old_left_s > 0
            ? texts.oldCodeWorks(clock(old_left_s))
            : texts.visitorsStay}
        </p>
      </div>
    </div>
  );
}
