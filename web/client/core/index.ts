export { CLIENT_MAX_BYTES, type Opened, open, PIN_MESSAGE_CMD, SERVER_MAX_BYTES, seal, TOLERANCE_S } from "./envelope";
export {
  BadPayload,
  BadPin,
  BadQrUrl,
  CacheFull,
  MalformedEnvelope,
  MalformedJwe,
  NotAuthentic,
  OpenError,
  PeerError,
  Replayed,
  Stale,
  TooLarge,
  UsageError,
  WrongTopic,
} from "./errors";
export type { Json, JsonObject } from "./json";
export { IV_BYTES, openJwe, sealJwe } from "./jwe";
export { deriveEpoch, type Epoch, Key } from "./keys";
export { Link, type LinkEvent, type Moved, type Notified, type Outgoing, type Rejected, type Replied } from "./link";
export { PartsInbox } from "./parts";
export { Pin } from "./pin";
export { type BrokerLogin, checkedLogin, DEFAULT_ROOT, type Invitation, invitation, PUBLISHED_KEYS, parseQrUrl, qrFragment } from "./qrurl";
export { ReplayCache } from "./replay";
export { fullTopic, isAddress, isClientId, type SubTopic, splitTopic } from "./topics";
