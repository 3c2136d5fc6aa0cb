// base64url (RFC 4648 §5), implemented here because lenient decoders accept several encodings of the same bytes, each of
// which would pass the replay cache or a filter. Only the canonical encoding is accepted.

const ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

const VALUE = new Int8Array(256).fill(-1);
for (let i = 0; i < 64; i += 1) VALUE[ALPHABET.charCodeAt(i)] = i;

/** Without padding. */
export function encodeBase64url(raw: Uint8Array): string {
  // In chunks: joining a megabyte character by character is slow on a phone.
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

/** Decode `text` (ASCII codes); undefined if it is not the canonical encoding of any bytes. */
export function decodeBase64url(text: Uint8Array): Uint8Array | undefined {
  const tail = text.length % 4;
  if (tail === 1) return undefined;
  const raw = new Uint8Array(Math.floor((text.length * 3) / 4));
  // Four letters at a time, validated at the end: most inputs are long.
  let seen = 0;
  let at = 0;
  for (let i = 0; i < text.length - tail; i += 4) {
    const bits = (valueAt(text, i) << 18) | (valueAt(text, i + 1) << 12) | (valueAt(text, i + 2) << 6) | valueAt(text, i + 3);
    // Invalid letters have the value -1, and make the sign of the whole negative.
    seen |= bits;
    raw[at] = bits >> 16;
    raw[at + 1] = bits >> 8;
    raw[at + 2] = bits;
    at += 3;
  }
  if (tail > 0) {
    const [a, b, c] = [0, 1, 2].map((j) => (j < tail ? valueAt(text, text.length - tail + j) : 0)) as [number, number, number];
    const bits = (a << 18) | (b << 12) | (c << 6);
    seen |= bits;
    raw[at] = bits >> 16;
    if (tail === 3) raw[at + 1] = bits >> 8;
    // Spare bits that are not zero: another encoding of the same bytes.
    if ((bits & (tail === 2 ? 0xffff : 0xff)) !== 0) return undefined;
  }
  return seen < 0 ? undefined : raw;
}

/** -1 for an invalid letter. */
function valueAt(text: Uint8Array, i: number): number {
  return VALUE[text[i] ?? 0] ?? -1;
}
