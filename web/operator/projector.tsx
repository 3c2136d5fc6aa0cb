// The projector's page: the code, the robots, and the visitors. It is read-only, and waits for a gateway that is away.

import { type ReactNode, useEffect, useState } from "react";
import { MapView } from "../map/map_view";
import { Mixed, operator as texts } from "../texts";
import { useLive } from "./live";
import { QrCode } from "./qr_code";
import { shortUrl } from "./words";

const EVERY_MS = 1000;
const ANSWER_WITHIN_MS = 4000;
const MOST_NAMES = 24;
const KEY = "phalanx-projector-token";

interface Shown {
  readonly page_url: string;
  readonly qr_svg: string;
  readonly room: string | null;
  readonly watch_only: boolean;
  readonly visitors: readonly { readonly name: string; readonly robot: string }[];
  /** With the robot and time of each turn; robot "": none will be free by then. */
  readonly queue: readonly { readonly name: string; readonly robot: string; readonly left_s: number }[];
  readonly caption: string;
  readonly held: boolean;
  readonly wifi: { readonly ssid: string; readonly svg: string } | null;
  readonly unreachable: string;
}

export function Projector() {
  const [token] = useState(takeToken);
  const { shown, away } = useShown(token);
  const live = useLive(token);
  if (token === "") return <p className="projector-alone">{texts.openByTheButton}</p>;
  if (!shown) return <p className="projector-alone">{texts.backInAMoment}</p>;
  return (
    <main className="projector">
      <section className="projector-way" aria-label={texts.howToJoin}>
        <h1>{shown.watch_only ? texts.watchWithYourPhone : texts.driveWithYourPhone}</h1>
        <div className="projector-codes">
          {shown.wifi && (
            <div>
              <p>
                <Mixed parts={texts.joinTheWifi(<strong>{shown.wifi.ssid}</strong>)} />
              </p>
              <QrCode svg={shown.wifi.svg} outOfOrder={undefined} />
            </div>
          )}
          <div>
            {shown.wifi && <p>{texts.thenScan}</p>}
            <QrCode svg={shown.qr_svg} outOfOrder={away ? texts.backInAMoment : shown.unreachable || undefined} />
          </div>
        </div>
        <p className="projector-address">{shortUrl(shown.page_url)}</p>
        {shown.room !== null && (
          <p data-testid="room">
            <Mixed parts={texts.noCamera(<strong className="projector-room">{spaced(shown.room)}</strong>)} />
          </p>
        )}
        <ol className="projector-steps">
          <Step picture={SCAN}>{texts.stepScan}</Step>
          <Step picture={CHOOSE}>{texts.stepTap}</Step>
          <Step picture={DRIVE}>{shown.watch_only ? texts.stepWatch : texts.stepDrive}</Step>
        </ol>
      </section>
      <section className="projector-map" aria-label={texts.robotsNow}>
        {shown.caption !== "" && (
          <p className="projector-caption" data-testid="caption">
            {shown.caption}
          </p>
        )}
        {shown.held && <p className="projector-caption">{texts.stoppedForAMoment}</p>}
        <MapView link={live} selected={undefined} onSelect={() => undefined} />
        <People shown={shown} />
      </section>
    </main>
  );
}

function People({ shown: { visitors, queue } }: { readonly shown: Shown }) {
  const more = visitors.length - MOST_NAMES;
  return (
    <div className="projector-people" data-testid="people">
      <p>
        <strong>{texts.visitorCount(visitors.length)}</strong>
        {visitors.slice(0, MOST_NAMES).map(({ name, robot }, i) => (
          <span key={i}> {robot === "" ? name : texts.nameDrives(name, robot)}</span>
        ))}
        {more > 0 && <span>{texts.andMore(more)}</span>}
      </p>
      {queue.length > 0 && (
        <p>
          <strong>{texts.next}</strong>
          {queue.slice(0, MOST_NAMES).map(({ name, robot, left_s }, i) => (
            <span key={i}> {`${i + 1}. ${robot === "" ? name : texts.nextDrives(name, robot, left_s)}`}</span>
          ))}
        </p>
      )}
    </div>
  );
}

function Step({ picture, children }: { readonly picture: string; readonly children: ReactNode }) {
  return (
    <li>
      <svg viewBox="0 0 48 48" aria-hidden="true">
        <path d={picture} />
      </svg>
      <span>{children}</span>
    </li>
  );
}

const PHONE = "M15 3h18a3 3 0 0 1 3 3v36a3 3 0 0 1-3 3H15a3 3 0 0 1-3-3V6a3 3 0 0 1 3-3Z";
const SCAN = `${PHONE}M17 13h5v5h-5ZM26 13h5v5h-5ZM17 22h5v5h-5ZM27 23h4v4h-4ZM21 40h6`;
const CHOOSE = `${PHONE}M24 14a7 7 0 1 1 0 14a7 7 0 0 1 0-14ZM24 21l0-4M21 40h6`;
const DRIVE = `${PHONE}M24 22a9 9 0 1 1 0 18a9 9 0 0 1 0-18ZM27 25a3 3 0 1 1-3 3M24 9v8M21 12l3-3 3 3`;

function spaced(room: string): string {
  return `${room.slice(0, 4)} ${room.slice(4)}`;
}

function useShown(token: string): { readonly shown: Shown | undefined; readonly away: boolean } {
  const [state, setState] = useState<{ shown: Shown | undefined; away: boolean }>({ shown: undefined, away: false });
  useEffect(() => {
    if (token === "") return;
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    async function round(): Promise<void> {
      const shown = await ask(token);
      if (ended) return;
      setState((before) => (shown ? { shown, away: false } : { ...before, away: true }));
      timer = setTimeout(() => void round(), EVERY_MS);
    }
    void round();
    return () => {
      ended = true;
      clearTimeout(timer);
    };
  }, [token]);
  return state;
}

async function ask(token: string): Promise<Shown | undefined> {
  try {
    const answer = await fetch("/api/projector", {
      headers: { Authorization: `Bearer ${token}` },
      cache: "no-store",
      credentials: "omit",
      redirect: "error",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    return answer.ok ? ((await answer.json()) as Shown) : undefined;
  } catch {
    return undefined; // the gateway is away, and the page retries
  }
}

/** The token from the address bar, which is removed there as it is projected; or the one stored before a reload. */
function takeToken(): string {
  const given = new URLSearchParams(window.location.hash.slice(1)).get("token");
  if (given !== null && /^[0-9a-f]{1,64}$/.test(given)) {
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
    try {
      window.sessionStorage.setItem(KEY, given);
    } catch {
      // Storage is forbidden: the page works until reloaded.
    }
    return given;
  }
  try {
    return window.sessionStorage.getItem(KEY) ?? "";
  } catch {
    return "";
  }
}
