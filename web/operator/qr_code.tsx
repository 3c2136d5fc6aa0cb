// The code itself: dark on white whatever the theme, because scanners want light around dark.

import { operator as texts } from "../texts";

interface Props {
  readonly svg: string;
  /** What it is for, for who does not see it. */
  readonly label?: string;
  /** Said over the code instead of showing it: nobody should scan a code that opens nothing. */
  readonly outOfOrder: string | undefined;
}

export function QrCode({ svg, label = texts.qrCode, outOfOrder }: Props) {
  // As an <img> nothing in the drawing can run or load, whatever it says.
  const url = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  return (
    <div className="qr" data-testid="qr" data-out-of-order={outOfOrder !== undefined}>
      <img src={url} alt={label} draggable={false} />
      {outOfOrder && <p className="qr-over">{outOfOrder}</p>}
    </div>
  );
}
