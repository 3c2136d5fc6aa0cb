// base64url (RFC 4648 §5), written here because a lenient decoder gives one message many spellings, and each would pass
// the replay cache or a filter anew. Only the one canonical spelling is read.

const ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

const VALUE = new Int8Array(128).fill(-1);
for (let i = 0; i < 64; i += 1) VALUE[ALPHABET.charCodeAt(i)] = i;

/** Without padding. */
export function encodeBase64url(raw: Uint8Array): string {
  // In pieces: a megabyte joined character by character is slow on a phone.
  const pieces: string[] = [];
  let piece = "";
  for (let i = 0; i < raw.length; i += 3) {
    const left = raw.length - i;
    const bits = ((raw[i] ?? 0) << 16) | ((raw[i + 1] ?? 0) << 8) | (raw[i + 2] ?? 0);
    piece += ALPHABET.charAt(bits >> 18);
    piece += ALPHABET.charAt((bits >> 12) & 63);
    if (left > 1) piece += ALPHABET.charAt((bits >> 6) & 63);
    if (left > 2) piece += ALPHABET.charAt(bits & 63);
    if (piece.length > 8192) {
      pieces.push(piece);
      piece = "";
    }
  }
  pieces.push(piece);
  return pieces.join("");
}

/** The bytes that `text` (ASCII codes) is the canonical encoding of, or undefined if there are none. */
export function decodeBase64url(text: Uint8Array): Uint8Array | undefined {
  const tail = text.length % 4;
  if (tail === 1) return undefined;
  const raw = new Uint8Array(Math.floor((text.length * 3) / 4));
  let bits = 0;
  let held = 0;
  let at = 0;
  for (const code of text) {
    const value = code < 128 ? (VALUE[code] ?? -1) : -1;
    if (value < 0) return undefined;
    bits = ((bits << 6) | value) & 0xffff;
    held += 6;
    if (held >= 8) {
      held -= 8;
      raw[at] = (bits >> held) & 0xff;
      at += 1;
    }
  }
  // Spare bits that are not zero: another spelling of the same bytes.
  return (bits & ((1 << held) - 1)) === 0 ? raw : undefined;
}
