// The code itself: dark on white whatever the theme, because scanners want light around dark.

import { useEffect, useState } from "react";

// As an <img> nothing in the drawing can run or load, whatever it says.
function useImageUrl(svg: string): string | undefined {
  const [url, setUrl] = useState<string>();
  useEffect(() => {
    // Drawings made to stand inside HTML leave the namespace out; an image is a document of its own and needs it.
    const whole = svg.includes("xmlns=") ? svg : svg.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"');
    const made = URL.createObjectURL(new Blob([whole], { type: "image/svg+xml" }));
    setUrl(made);
    return () => URL.revokeObjectURL(made);
  }, [svg]);
  return url;
}

interface Props {
  readonly svg: string;
  /** Said over the code instead of showing it: nobody should scan a code that opens nothing. */
  readonly outOfOrder: string | undefined;
}

export function QrCode({ svg, outOfOrder }: Props) {
  const url = useImageUrl(svg);
  return (
    <div className="qr" data-testid="qr" data-out-of-order={outOfOrder !== undefined}>
      {url && <img src={url} alt="QR code that opens the visitor page" draggable={false} />}
      {outOfOrder && <p className="qr-over">{outOfOrder}</p>}
    </div>
  );
}
