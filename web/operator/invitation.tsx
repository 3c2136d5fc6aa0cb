// The visitors' code, with its address and remaining time.

import { useEffect, useRef, useState } from "react";
import { inSameLanguage, operator as texts } from "../texts";
import { Countdown } from "./countdown";
import type { Exhibition } from "./exhibition";
import { order, type Station } from "./station";
import type { Sample } from "./poll";
import { QrCode } from "./qr_code";
import { shortUrl } from "./words";

const SAID_FOR_MS = 2500;

interface Props {
  readonly station: Station;
  readonly newest: Sample;
  readonly outOfOrder: string | undefined;
  readonly exhibition: Exhibition;
}

export function Invitation({ station, newest, outOfOrder, exhibition }: Props) {
  const button = useRef<HTMLButtonElement>(null);
  const { on, enter, leave } = exhibition;
  const { session, mode } = newest.state;
  const isShared = session === undefined || mode === "qrkey";
  const wasOn = useRef(on);
  useEffect(() => {
    // The button under the pointer has changed; keyboard focus stays on it.
    if (wasOn.current !== on) button.current?.focus();
    wasOn.current = on;
  }, [on]);

  return (
    <section className="invitation" aria-label={texts.invitation}>
      <h1>{newest.state.mission ? texts.scanToWatch : texts.scanToDrive}</h1>
      <QrCode svg={newest.state.qr_svg} outOfOrder={outOfOrder} />
      <p className="page-url">{shortUrl(newest.state.page_url)}</p>
      {session?.room !== undefined && <RoomDigits room={session.room} />}
      <div className="invitation-foot">
        <Countdown newest={newest} />
        <div className="buttons">
          {!on && <NewCode station={station} isShared={isShared} overlapping={newest.state.overlapping} />}
          {!on && session && <RoomToggle station={station} isShown={session.room !== undefined} />}
          {!on && <CopyLink url={newest.state.qr_url} />}
          {!on && newest.state.projector !== "" && (
            <a className="button" href={inSameLanguage(newest.state.projector, window.location.search)} target="_blank" rel="noreferrer">
              {texts.projector}
            </a>
          )}
          <button ref={button} type="button" className={on ? "subtle" : "primary"} onClick={on ? leave : enter}>
            {on ? texts.backToTheOverview : texts.qrOnly}
          </button>
        </div>
      </div>
    </section>
  );
}

interface NewCodeProps {
  readonly station: Station;
  readonly isShared: boolean;
  readonly overlapping: boolean;
}

function NewCode({ station, isShared, overlapping }: NewCodeProps) {
  const [trouble, setTrouble] = useState<string>();
  const tip = isShared ? texts.terms.sharedCode : texts.terms.newCode;
  return (
    <>
      <button
        type="button"
        data-testid="new-code"
        // With a shared code only one overlap at a time: phones that miss two new codes would get neither.
        disabled={isShared && overlapping}
        data-tip={tip}
        aria-description={tip}
        onClick={async () => setTrouble(await order(station, "rotate"))}
      >
        {texts.newCodeNow}
      </button>
      {trouble !== undefined && (
        <span className="trouble" role="alert">
          {trouble}
        </span>
      )}
    </>
  );
}

/** Large, because visitors type it. */
function RoomDigits({ room }: { readonly room: string }) {
  return (
    <p className="room">
      <span className="quiet">{texts.roomCode}</span>{" "}
      <strong className="room-digits" data-testid="room-digits">
        {room.slice(0, 4)} {room.slice(4)}
      </strong>
    </p>
  );
}

function RoomToggle({ station, isShown }: { readonly station: Station; readonly isShown: boolean }) {
  return (
    <button
      type="button"
      data-testid="room-toggle"
      data-tip={texts.terms.room}
      aria-description={texts.terms.room}
      onClick={() => void order(station, "room", { show: !isShown })}
    >
      {isShown ? texts.hideRoomCode : texts.showRoomCode}
    </button>
  );
}

// The link contains the code, so it is copied but never shown: this page is on a projector.
function CopyLink({ url }: { readonly url: string }) {
  const [said, setSaid] = useState<string>();
  useEffect(() => {
    if (said === undefined) return;
    const timer = window.setTimeout(() => setSaid(undefined), SAID_FOR_MS);
    return () => window.clearTimeout(timer);
  }, [said]);

  async function copy() {
    try {
      await navigator.clipboard.writeText(url);
      setSaid(texts.copied);
    } catch {
      setSaid(texts.notAllowedHere);
    }
  }

  return (
    <button type="button" onClick={copy} title={texts.whyCopy}>
      <span aria-live="polite">{said ?? texts.copyLink}</span>
    </button>
  );
}
