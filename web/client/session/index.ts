export { type EndReason, BadInvitation, type Reason } from "./errors";
export { checkWhere, DIRECT, fragmentOf, type Invitation, parseInvitation, parseRoomCode, type Where } from "./invitation";
export type { Role, Standing } from "./messages";
export { type Kind, Secret } from "./secret";
export { Session, type SessionEvent } from "./session";
export { type Saying, SLOT_MS, Slots } from "./slots";
