// The library's exports: protocol, connection, hooks, and the swarm's vocabulary.

export { decodeBase64url } from "./core/base64url";
export { UsageError } from "./core/errors";
export { isObject, type Json, type JsonObject } from "./core/json";
export { MOST_ROBOTS } from "./frame";
export {
  BadInvitation,
  DIRECT,
  parseInvitation,
  parseRoomCode,
  type Reason,
  type Role,
  Secret,
  fragmentOf as sessionFragment,
  type Invitation as SessionInvitation,
  type Standing,
  type Where as SessionWhere,
} from "./session";
export { ResumeStore, browserStores, type Kept } from "./io/resume_store";
export { SessionConnection, type SessionTo } from "./io/session_connection";
export { linkUrl } from "./io/link_url";
export { WebsocketWay } from "./io/websocket_way";
export { fetchSwarmKey } from "./io/swarm_key";
export { type Transport, type TransportEvent, Refused, Unanswered } from "./io/transport";
export { SwarmLink, type SwarmSource, type SwarmView } from "./io/swarm_link";
export { useCommand, useLink, useRequest, useSwarm } from "./react/hooks";
export {
  type Drift,
  type Lit,
  type Missions,
  type Phase,
  type Progress,
  readDrift,
  type Walk,
  type Wall,
} from "./mission";
export { ACTIVE, INACTIVE, LOST, label, nameWithDriver, type Rgb, type Robot, sentence, shortAddress, shortName } from "./robot";
export { type Audit, counting, LOW_MS, type Shield, type ShieldTerms, type Voucher } from "./shield";
export {
  type Area,
  driversOf,
  NO_SWARM,
  REQUEST_AREA,
  REQUEST_LIT,
  REQUEST_ROBOTS,
  REQUEST_WALLS,
  type RosterEntry,
  type Swarm,
  type SwarmAction,
  swarmReducer,
} from "./swarm";
export { type Point, TRAIL_POINTS, Trail } from "./trail";
export type { Work } from "./work";
export { NO_VISIT, type OverReason, type Stage, type Visit } from "./visit";
export type { BrokerState, Health } from "./watch";
