// The one JWE form that the link speaks: compact, `dir`, A256GCM (RFC 7516).
//
// A general JOSE library reads headers that the sender chose; here there is one header, compared as bytes. noble and not
// WebCrypto: browsers hide crypto.subtle from pages of an http:// LAN address, and that is where this page lives.

import { gcm } from "@noble/ciphers/aes.js";
import { decodeBase64url, encodeBase64url } from "./base64url";
import { MalformedJwe, NotAuthentic, TooLarge } from "./errors";
import type { Key } from "./keys";

export const IV_BYTES = 12;
const TAG_BYTES = 16;
const DOT = 0x2e;

const encoder = new TextEncoder();
const HEADER = encoder.encode('{"alg":"dir","enc":"A256GCM"}');
const HEADER_SEGMENT = encodeBase64url(HEADER);
const AAD = encoder.encode(HEADER_SEGMENT);

/** The compact JWE of `plaintext`, as ASCII bytes. `iv` is 12 bytes, never used twice with one key. */
export function sealJwe(plaintext: Uint8Array, key: Key, iv: Uint8Array): Uint8Array {
  const sealed = gcm(key.reveal(), iv, AAD).encrypt(plaintext);
  const split = sealed.length - TAG_BYTES;
  const text = [
    encodeBase64url(iv),
    encodeBase64url(sealed.subarray(0, split)),
    encodeBase64url(sealed.subarray(split)),
  ];
  return encoder.encode(`${HEADER_SEGMENT}..${text.join(".")}`);
}

/**
 * IV and plaintext of a compact JWE.
 *
 * Source: RFC 7516 §5.2, restricted as docs/spec/link.md says.
 * @param max_bytes longest plaintext to accept; checked before anything is decrypted.
 * @throws TooLarge, MalformedJwe, NotAuthentic
 */
export function openJwe(token: Uint8Array, key: Key, max_bytes: number): { iv: Uint8Array; plaintext: Uint8Array } {
  const { iv, sealed } = segments(token, max_bytes);
  try {
    return { iv, plaintext: gcm(key.reveal(), iv, AAD).decrypt(sealed) };
  } catch {
    throw new NotAuthentic("the tag does not verify");
  }
}

function segments(token: Uint8Array, max_bytes: number): { iv: Uint8Array; sealed: Uint8Array } {
  // Slack for the base64 rounding; the ciphertext is measured exactly below.
  const longest = Math.floor(((max_bytes + IV_BYTES + TAG_BYTES + HEADER.length) * 4) / 3) + 16;
  if (token.length > longest) throw new TooLarge(`${token.length} bytes sealed, limit ${max_bytes} of plaintext`);

  const parts = splitAtDots(token);
  const [header, encryptedKey, ivText, ciphertextText, tagText] = parts;
  if (!header || !encryptedKey || !ivText || !ciphertextText || !tagText || parts.length !== 5) {
    throw new MalformedJwe("not five segments");
  }
  if (encryptedKey.length !== 0 || !sameBytes(header, AAD)) throw new MalformedJwe("another header, or a key segment");

  const iv = decodeBase64url(ivText);
  const ciphertext = decodeBase64url(ciphertextText);
  const tag = decodeBase64url(tagText);
  if (!iv || !ciphertext || !tag) throw new MalformedJwe("a segment is not canonical base64url");
  if (iv.length !== IV_BYTES || tag.length !== TAG_BYTES) throw new MalformedJwe("IV or tag of another length");
  if (ciphertext.length > max_bytes) throw new TooLarge(`${ciphertext.length} bytes of plaintext, limit ${max_bytes}`);

  const sealed = new Uint8Array(ciphertext.length + TAG_BYTES);
  sealed.set(ciphertext);
  sealed.set(tag, ciphertext.length);
  return { iv, sealed };
}

/** At most six parts: a message of dots must not become a million of them. */
function splitAtDots(token: Uint8Array): Uint8Array[] {
  const parts: Uint8Array[] = [];
  let from = 0;
  while (parts.length < 5) {
    const dot = token.indexOf(DOT, from);
    if (dot < 0) break;
    parts.push(token.subarray(from, dot));
    from = dot + 1;
  }
  parts.push(token.subarray(from));
  return parts;
}

function sameBytes(a: Uint8Array, b: Uint8Array): boolean {
  return a.length === b.length && a.every((byte, i) => byte === b[i]);
}
