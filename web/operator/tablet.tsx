// A code that makes a tablet an operator's: for one use, valid for ten minutes.

import { useState } from "react";
import { isObject } from "../client";
import { operator as texts } from "../texts";
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
        {svg === undefined ? texts.onATablet : texts.hideTheCode}
      </button>
      {trouble && (
        <span className="trouble" role="alert">
          {texts.doesNotAnswer}
        </span>
      )}
      {svg !== undefined && (
        <section className="tablet" aria-label={texts.tabletCode}>
          <QrCode svg={svg} label={texts.tabletQrCode} outOfOrder={undefined} />
          <p>
            <strong>{texts.whoScansIsOperator}</strong> {texts.oneTablet}
          </p>
        </section>
      )}
    </>
  );
}
