// Made by docs/generate.py from src/phalanx/wire/sessions.py.

import { layout } from "./layout";

export const VERSION = 1;
export const TAG_BYTES = 16;

/** in the fragment of a QR code's URL, as base64url without padding; the tag is its version */
export interface InvitationFields {
  readonly kind: number;
  readonly static: Uint8Array;
  readonly secret: Uint8Array;
  readonly mqtt: number;
  readonly root: Uint8Array;
  readonly broker: Uint8Array;
}
export const INVITATION = layout<InvitationFields>("invitation", 0x01, { kind: "u8", static: "b32", secret: "b16", mqtt: "u8", root: "v8", broker: "v8" });

/** the client's first message; the tag is the version */
export interface HelloFields {
  readonly kind: number;
  readonly id: Uint8Array;
  readonly noise: Uint8Array;
}
export const HELLO = layout<HelloFields>("hello", 0x01, { kind: "u8", id: "b8", noise: "b48" });

/** hello over a broker */
export interface SignedHelloFields {
  readonly kind: number;
  readonly id: Uint8Array;
  readonly noise: Uint8Array;
  readonly mac1: Uint8Array;
}
export const SIGNED_HELLO = layout<SignedHelloFields>("signed_hello", 0x01, { kind: "u8", id: "b8", noise: "b48", mac1: "b16" });

/** the server's answer */
export interface AcceptFields {
  readonly generation: number;
  readonly noise: Uint8Array;
}
export const ACCEPT = layout<AcceptFields>("accept", 0x02, { generation: "u8", noise: "b48" });

/** Noise prologue of the handshake */
export interface PrologueFields {
  readonly version: Uint8Array;
  readonly kind: Uint8Array;
  readonly id: Uint8Array;
  readonly root: Uint8Array;
  readonly broker: Uint8Array;
}
export const PROLOGUE = layout<PrologueFields>("prologue", undefined, { version: "v8", kind: "v8", id: "v8", root: "v8", broker: "v8" });

/** associated data of a record; its nonce is the counter */
export interface RecordHeadFields {
  readonly generation: number;
  readonly counter: number;
}
export const RECORD_HEAD = layout<RecordHeadFields>("record_head", 0x10, { generation: "u8", counter: "u64" });

/** one message of a session */
export interface RecordFields {
  readonly generation: number;
  readonly counter: number;
  readonly sealed: Uint8Array;
}
export const RECORD = layout<RecordFields>("record", 0x10, { generation: "u8", counter: "u64", sealed: "rest" });

/** associated data of an update; its nonce is the counter */
export interface UpdateHeadFields {
  readonly epoch: number;
  readonly counter: number;
}
export const UPDATE_HEAD = layout<UpdateHeadFields>("update_head", 0x11, { epoch: "u32", counter: "u64" });

/** the state of the swarm, for all visitors */
export interface UpdateFields {
  readonly epoch: number;
  readonly counter: number;
  readonly signature: Uint8Array;
  readonly sealed: Uint8Array;
}
export const UPDATE = layout<UpdateFields>("update", 0x11, { epoch: "u32", counter: "u64", signature: "b64", sealed: "rest" });

/** signed bytes of an update */
export interface SignedUpdateFields {
  readonly epoch: number;
  readonly counter: number;
  readonly sealed: Uint8Array;
}
export const SIGNED_UPDATE = layout<SignedUpdateFields>("signed_update", 0x12, { epoch: "u32", counter: "u64", sealed: "rest" });

/** plaintext of a record or an update, padded to the next allowed size */
export interface PaddedFields {
  readonly length: number;
  readonly content: Uint8Array;
}
export const PADDED = layout<PaddedFields>("padded", undefined, { length: "u32", content: "rest" });

/** first message of a new visitor */
export interface JoinFields {
  readonly name: Uint8Array;
}
export const JOIN = layout<JoinFields>("join", 0x21, { name: "v8" });

/** first message of a resuming visitor, and after each new key */
export type ReadyFields = object;
export const READY = layout<ReadyFields>("ready", 0x22, {});

/** the client has stored the resume secret */
export interface StoredFields {
  readonly id: Uint8Array;
}
export const STORED = layout<StoredFields>("stored", 0x23, { id: "b8" });

/** command for one robot */
export interface CommandFields {
  readonly stop: number;
  readonly seen: number;
  readonly digest: Uint8Array;
  readonly robot: Uint8Array;
  readonly name: Uint8Array;
  readonly payload: Uint8Array;
}
export const COMMAND = layout<CommandFields>("command", 0x24, { stop: "u8", seen: "u64", digest: "b8", robot: "v8", name: "v8", payload: "rest" });

/** answered with `reply` or `refused` */
export interface LinkRequestFields {
  readonly number: number;
  readonly name: Uint8Array;
  readonly payload: Uint8Array;
}
export const LINK_REQUEST = layout<LinkRequestFields>("link_request", 0x25, { number: "u32", name: "v8", payload: "rest" });

/** end of the session; the resume secret stays valid */
export interface LeaveFields {
  readonly keep: number;
}
export const LEAVE = layout<LeaveFields>("leave", 0x26, { keep: "u8" });

/** keep-alive without content */
export type AliveFields = object;
export const ALIVE = layout<AliveFields>("alive", 0x27, {});

/** first message to an admitted visitor */
export interface WelcomeFields {
  readonly visitor: number;
  readonly signer: Uint8Array;
  readonly name: Uint8Array;
}
export const WELCOME = layout<WelcomeFields>("welcome", 0x41, { visitor: "u32", signer: "b32", name: "v8" });

/** new resume secret; answered with `stored` */
export interface SecretFields {
  readonly secret: Uint8Array;
  readonly lifetime_s: number;
}
export const SECRET = layout<SecretFields>("secret", 0x42, { secret: "b32", lifetime_s: "u32" });

/** key for the updates that follow */
export interface EpochFields {
  readonly epoch: number;
  readonly counter: number;
  readonly chain: Uint8Array;
  readonly topic: Uint8Array;
}
export const EPOCH = layout<EpochFields>("epoch", 0x43, { epoch: "u32", counter: "u64", chain: "b32", topic: "b16" });

/** current rights of the visitor */
export interface StandingFields {
  readonly role: number;
  readonly waiting: number;
  readonly place: number;
  readonly left_ms: number;
  readonly robot: Uint8Array;
}
export const STANDING = layout<StandingFields>("standing", 0x44, { role: "u8", waiting: "u8", place: "u16", left_ms: "u32", robot: "v8" });

/** answer to a request */
export interface ReplyFields {
  readonly number: number;
  readonly payload: Uint8Array;
}
export const REPLY = layout<ReplyFields>("reply", 0x45, { number: "u32", payload: "rest" });

/** a command or request was not carried out */
export interface RefusedFields {
  readonly number: number;
  readonly reason: number;
}
export const REFUSED = layout<RefusedFields>("refused", 0x47, { number: "u32", reason: "u8" });

/** the session is over */
export interface EndFields {
  readonly reason: number;
}
export const END = layout<EndFields>("end", 0x48, { reason: "u8" });
