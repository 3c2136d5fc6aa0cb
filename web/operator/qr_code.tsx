// The QR code: dark on white in every theme, because scanners need a light border.

import { operator as texts } from "../texts";

interface Props {
  readonly svg: string;
  /** Description for screen readers. */
  readonly label?: string;
  /** Text shown over the code if it is invalid, so that nobody scans it. */
  readonly outOfOrder: string | undefined;
}

export function QrCode({ svg, label = texts.qrCode, outOfOrder }: Props) {
  // As an <img>, the SVG can neither run scripts nor load resources.
  const url = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  return (
    <div className="qr" data-testid="qr" data-out-of-order={outOfOrder !== undefined}>
      <img src={url} alt={label} draggable={false} />
      {outOfOrder && <p className="qr-over">{outOfOrder}</p>}
    </div>
  );
}
