// A code that makes a tablet an operator's: for one use, within ten minutes.

import { useState } from "react";
import { isObject } from "../client";
import { QrCode } from "./qr_code";
import type { Station } from "./station";

const VALID_S = 600;

export function TabletButton({ station }: { readonly station: Station }) {
  const [svg, setSvg] = useState<string>();
  const [trouble, setTrouble] = useState(false);

  async function show() {
    setTrouble(false);
    try {
      const said = await station.ask("invite", { role: "operate", valid_s: VALID_S });
      if (isObject(said) && typeof said["svg"] === "string") setSvg(said["svg"]);
    } catch {
      setTrouble(true);
    }
  }

  return (
    <>
      <button type="button" data-testid="tablet" aria-expanded={svg !== undefined} onClick={() => (svg === undefined ? void show() : setSvg(undefined))}>
        {svg === undefined ? "On a tablet" : "Hide the code"}
      </button>
      {trouble && (
        <span className="trouble" role="alert">
          The gateway does not answer.
        </span>
      )}
      {svg !== undefined && (
        <section className="tablet" aria-label="Code for an operator’s tablet">
          <QrCode svg={svg} label="QR code that makes a tablet an operator’s" outOfOrder={undefined} />
          <p>
            <strong>Whoever scans this is an operator.</strong> One tablet, within ten minutes.
          </p>
        </section>
      )}
    </>
  );
}
