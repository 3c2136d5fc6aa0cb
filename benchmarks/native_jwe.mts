// web/client/core/jwe.ts once more, by what is built into Node: the same form, read as strictly, by the same names.

import { createCipheriv, createDecipheriv } from "node:crypto";
import { MalformedJwe, NotAuthentic, TooLarge } from "../web/client/core/errors";
import type { Key } from "../web/client/core/keys";

export const IV_BYTES = 12;
const TAG_BYTES = 16;
const CIPHER = "aes-256-gcm";
const HEADER = '{"alg":"dir","enc":"A256GCM"}';
const HEADER_SEGMENT = Buffer.from(HEADER).toString("base64url");
const AAD = Buffer.from(HEADER_SEGMENT);

export function sealJwe(plaintext: Uint8Array, key: Key, iv: Uint8Array): Uint8Array {
  const cipher = createCipheriv(CIPHER, key.reveal(), iv, { authTagLength: TAG_BYTES }).setAAD(AAD);
  const sealed = Buffer.concat([cipher.update(plaintext), cipher.final()]);
  const segments = [Buffer.from(iv), sealed, cipher.getAuthTag()].map((raw) => raw.toString("base64url"));
  return Buffer.from(`${HEADER_SEGMENT}..${segments.join(".")}`);
}

/** @throws TooLarge, MalformedJwe, NotAuthentic */
export function openJwe(token: Uint8Array, key: Key, max_bytes: number): { iv: Uint8Array; plaintext: Uint8Array } {
  const longest = Math.floor(((max_bytes + IV_BYTES + TAG_BYTES + HEADER.length) * 4) / 3) + 16;
  if (token.length > longest) throw new TooLarge(`${token.length} bytes sealed, limit ${max_bytes} of plaintext`);
  // A byte a character, whatever the byte.
  const segments = Buffer.from(token.buffer, token.byteOffset, token.length).toString("latin1").split(".", 6);
  const [header, encryptedKey, ivText = "", ciphertextText = "", tagText = ""] = segments;
  if (segments.length !== 5) throw new MalformedJwe("not five segments");
  if (header !== HEADER_SEGMENT || encryptedKey !== "") throw new MalformedJwe("another header, or a key segment");
  const [iv, ciphertext, tag] = [decode(ivText), decode(ciphertextText), decode(tagText)];
  if (iv.length !== IV_BYTES || tag.length !== TAG_BYTES) throw new MalformedJwe("IV or tag of another length");
  if (ciphertext.length > max_bytes) throw new TooLarge(`${ciphertext.length} bytes of plaintext, limit ${max_bytes}`);
  const decipher = createDecipheriv(CIPHER, key.reveal(), iv, { authTagLength: TAG_BYTES });
  const plaintext = decipher.setAAD(AAD).setAuthTag(tag).update(ciphertext);
  try {
    decipher.final();
  } catch {
    throw new NotAuthentic("the tag does not verify");
  }
  return { iv, plaintext };
}

function decode(text: string): Buffer {
  const raw = Buffer.from(text, "base64url");
  // Node reads many spellings of the same bytes, and skips what it cannot read: only one of them is canonical.
  if (raw.toString("base64url") !== text) throw new MalformedJwe("a segment is not canonical base64url");
  return raw;
}
