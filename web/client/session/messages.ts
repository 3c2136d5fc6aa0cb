// Messages of the server, with validated texts and numbers.

import { type EndReason, ENDS, type Reason, REASONS, Unexpected } from "./errors";
import { MalformedRecord } from "./layout";
import { END, EPOCH, type EpochFields, REFUSED, REPLY, SECRET, STANDING, WELCOME } from "./records";
import { Secret } from "./secret";

/** Rights of a visitor; each includes the previous ones. */
export const ROLES = ["", "watch", "drive", "operate"] as const;
export type Role = Exclude<(typeof ROLES)[number], "">;

/** A visitor's current rights. */
export interface Standing {
  readonly role: Role;
  /** Waits for the operator's approval, without updates. */
  readonly waiting: boolean;
  /** Position in the queue for a robot, from 1; 0: not queued. */
  readonly place: number;
  /** Remaining time of its turn; 0: no limit. */
  readonly left_ms: number;
  /** Assigned robot; empty: none. */
  readonly robot: string;
}

export type ServerMessage =
  | { readonly kind: "welcome"; readonly visitor: number; readonly signer: Uint8Array; readonly name: string }
  | { readonly kind: "secret"; readonly secret: Secret; readonly lifetime_s: number }
  | { readonly kind: "epoch"; readonly epoch: EpochFields }
  | { readonly kind: "standing"; readonly standing: Standing }
  | { readonly kind: "reply"; readonly number: number; readonly payload: Uint8Array }
  | { readonly kind: "refused"; readonly number: number; readonly reason: Reason }
  | { readonly kind: "end"; readonly reason: EndReason };

const utf8 = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });

/** @throws Unexpected: unknown message; MalformedRecord: malformed. */
export function decodeMessage(content: Uint8Array): ServerMessage {
  switch (content[0]) {
    case WELCOME.tag: {
      const { visitor, signer, name } = WELCOME.decode(content);
      return { kind: "welcome", visitor, signer, name: textOf(name) };
    }
    case SECRET.tag: {
      const { secret, lifetime_s } = SECRET.decode(content);
      return { kind: "secret", secret: new Secret("resume", secret), lifetime_s };
    }
    case EPOCH.tag:
      return { kind: "epoch", epoch: EPOCH.decode(content) };
    case STANDING.tag: {
      const { role, waiting, place, left_ms, robot } = STANDING.decode(content);
      if (waiting > 1) throw new MalformedRecord("standing: waiting is 0 or 1");
      const standing = { role: nameOf(ROLES, role), waiting: waiting === 1, place, left_ms, robot: textOf(robot) };
      return { kind: "standing", standing };
    }
    case REPLY.tag:
      return { kind: "reply", ...REPLY.decode(content) };
    case REFUSED.tag: {
      const { number, reason } = REFUSED.decode(content);
      return { kind: "refused", number, reason: nameOf(REASONS, reason) };
    }
    case END.tag:
      return { kind: "end", reason: nameOf(ENDS, END.decode(content).reason) };
    default:
      throw new Unexpected("no message of this kind");
  }
}

function textOf(raw: Uint8Array): string {
  try {
    return utf8.decode(raw);
  } catch {
    throw new MalformedRecord("not UTF-8");
  }
}

function nameOf<T extends string>(names: readonly T[], number: number): Exclude<T, ""> {
  const name = names[number];
  if (name === undefined || name === "") throw new MalformedRecord(`${number} means nothing`);
  return name as Exclude<T, "">;
}
