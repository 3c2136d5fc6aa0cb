// Invitations, as in a QR code's fragment, and room codes, which people type. Errors never repeat the input.

import { decodeBase64url, encodeBase64url } from "../core/base64url";
import { PeerError, UsageError } from "../core/errors";
import { BadInvitation } from "./errors";
import { INVITATION } from "./records";
import { KINDS, Secret } from "./secret";

const WORD = "j=";
const FRAGMENT_LONGEST = 1024;
const BROKER = /^wss?:\/\/([0-9a-z._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?(\/[^?#\s]*)?$/i;
const ROOT = /^\/[0-9A-Za-z_-]{1,64}(\/[0-9A-Za-z_-]{1,64}){0,7}$/;
const ASCII = /^[\x21-\x7e]*$/;
const ROOM = /^[0-9]{8}$/;

const bytes = new TextEncoder();
const text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });

/** A broker with its topic root; without a broker the connection is direct, and root and mqtt are empty and 0. */
export interface Where {
  readonly broker: string;
  readonly root: string;
  readonly mqtt: number;
}

/** Everything that a visitor needs to join. */
export interface Invitation extends Where {
  /** The swarm's X25519 public key. */
  readonly fixed: Uint8Array;
  readonly secret: Secret;
}

/** The swarm is at the page's own origin. */
export const DIRECT: Where = { broker: "", root: "", mqtt: 0 };

/** Parse the invitation in a URL, or in its fragment. @throws BadInvitation */
export function parseInvitation(given: string): Invitation {
  const word = given.trim().split("#").at(-1) ?? "";
  if (!word.startsWith(WORD) || word.length > FRAGMENT_LONGEST || !ASCII.test(word)) throw new BadInvitation("no such fragment");
  const { kind, fixed, secret, mqtt, root, broker } = read(word.slice(WORD.length));
  if (kind !== "open" && kind !== "ticket") throw new BadInvitation("of another kind");
  const invitation = { fixed, secret: new Secret(kind, secret), broker, root, mqtt };
  checkWhere(invitation);
  return invitation;
}

/** Return its fragment, without `#`. @throws UsageError: room codes and resume secrets have no URL. */
export function fragmentOf({ secret, fixed, mqtt, root, broker }: Invitation): string {
  if (secret.kind !== "open" && secret.kind !== "ticket") throw new UsageError("only open codes and tickets have a URL");
  const values = { static: fixed, secret: secret.reveal(), mqtt, root: bytes.encode(root), broker: bytes.encode(broker) };
  return WORD + encodeBase64url(INVITATION.encode({ kind: secret.number, ...values }));
}

/** Return the secret of a typed room code. @throws BadInvitation */
export function parseRoomCode(typed: string): Secret {
  const digits = typed.replace(/[\s-]+/g, "");
  if (!ROOM.test(digits)) throw new BadInvitation("a room code has 8 digits");
  return new Secret("room", bytes.encode(digits));
}

function read(word: string): { kind: string; fixed: Uint8Array; secret: Uint8Array; mqtt: number; root: string; broker: string } {
  try {
    const raw = decodeBase64url(bytes.encode(word));
    if (raw === undefined) throw new BadInvitation("cut off");
    const { kind, static: fixed, secret, mqtt, root, broker } = INVITATION.decode(raw);
    return { kind: KINDS[kind] ?? "", fixed, secret, mqtt, root: text.decode(root), broker: text.decode(broker) };
  } catch (error) {
    if (error instanceof PeerError || error instanceof TypeError) throw new BadInvitation("cut off, or of another version");
    throw error;
  }
}

/** @throws BadInvitation */
export function checkWhere({ broker, root, mqtt }: Where): void {
  if (broker === "") {
    if (root !== "" || mqtt !== 0) throw new BadInvitation("a root or MQTT version without a broker");
    return;
  }
  if (!BROKER.test(broker)) throw new BadInvitation("the broker is not a ws:// or wss:// URL");
  if (mqtt !== 4 && mqtt !== 5) throw new BadInvitation("MQTT version is 4 or 5");
  if (!ROOT.test(root)) throw new BadInvitation("the root is not a topic");
}
