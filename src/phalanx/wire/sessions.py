"""Records of the link's sessions: handshake, messages, and the rows of visitors on disk. Part of the byte table.

`docs/generate.py` writes the tables of docs/spec/session.md and web/client/session/records.ts from this file.
"""

from __future__ import annotations

from .record import record

VERSION = 1
NOISE_BYTES = 48  # a handshake message with an empty payload: ephemeral public key and tag
TAG_BYTES = 16  # ChaCha20-Poly1305
LINK_PATH = "/link"  # path of the websocket, at the origin of the page

# --- invitations ---------------------------------------------------------------------------------------------------

INVITATION = record(
    "invitation: in the fragment of a QR code's URL, as base64url without padding; the tag is its version",
    "kind u8: 1 open, 2 ticket",
    "static b32: the swarm's X25519 public key",
    "secret b16: random",
    "mqtt u8: MQTT version 5 or 4; 0: no broker, root and broker are empty",
    "root v8: first part of every topic",
    "broker v8: ws or wss URL",
    tag=VERSION,
)

# --- handshake -----------------------------------------------------------------------------------------------------

HELLO = record(
    "hello: the client's first message; the tag is the version",
    "kind u8: kind of the secret: 1 open, 2 ticket, 3 room, 4 resume",
    "id b8: id of the secret; zeros for a room code",
    f"noise b{NOISE_BYTES}: first message of Noise NKpsk0",
    tag=VERSION,
)
SIGNED_HELLO = record(
    "signed_hello: hello over a broker", *HELLO.fields, "mac1 b16: HMAC-SHA256 over hello, truncated", tag=VERSION
)
ACCEPT = record(
    "accept: the server's answer",
    "generation u8: generation of the keys that this handshake derives",
    f"noise b{NOISE_BYTES}: second message of Noise NKpsk0",
    tag=0x02,
)
PROLOGUE = record(
    "prologue: Noise prologue of the handshake",
    "version v8: as in hello",
    "kind v8: as in hello",
    "id v8: as in hello",
    "root v8: as in the invitation; empty without a broker",
    "broker v8: as in the invitation; empty without a broker",
)

# --- records -------------------------------------------------------------------------------------------------------

_RECORD_HEAD = ("generation u8: generation of the keys", "counter u64: from 0 in each direction and generation")
RECORD_HEAD = record("record_head: associated data of a record; its nonce is the counter", *_RECORD_HEAD, tag=0x10)
RECORD = record("record: one message of a session", *_RECORD_HEAD, "sealed rest: encrypted `padded`", tag=0x10)
_UPDATE_HEAD = ("epoch u32: epoch of the key", "counter u64: from 1, rises by 1 with each update, over all epochs")
UPDATE_HEAD = record("update_head: associated data of an update; its nonce is the counter", *_UPDATE_HEAD, tag=0x11)
UPDATE = record(
    "update: the state of the swarm, for all visitors",
    *_UPDATE_HEAD,
    "signature b64: Ed25519, over signed_update",
    "sealed rest: encrypted `padded`",
    tag=0x11,
)
SIGNED_UPDATE = record("signed_update: signed bytes of an update", *_UPDATE_HEAD, "sealed rest: as in update", tag=0x12)
PADDED = record(
    "padded: plaintext of a record or an update, padded to the next allowed size",
    "length u32: bytes of content",
    "content rest: content, then zeros",
)

# --- messages of a client --------------------------------------------------------------------------------------------

JOIN = record("join: first message of a new visitor", "name v8: nickname, UTF-8; may be empty", tag=0x21)
READY = record("ready: first message of a resuming visitor, and after each new key", tag=0x22)
STORED = record("stored: the client has stored the resume secret", "id b8: id of that secret", tag=0x23)
COMMAND = record(
    "command: command for one robot",
    "stop u8: 1: stops the robot; never too late, and needs no lease",
    "seen u64: counter of the newest update that the client has read; 0: none yet",
    "digest b8: first bytes of that update's SHA-256",
    "robot v8: address, ASCII",
    "name v8: name of the command, ASCII",
    "payload rest: JSON",
    tag=0x24,
)
LINK_REQUEST = record(
    "link_request: answered with `reply` or `refused`",
    "number u32: request number of this client, from 1",
    "name v8: name of the request, ASCII",
    "payload rest: JSON, or empty",
    tag=0x25,
)
LEAVE = record(
    "leave: end of the session; the resume secret stays valid",
    "keep u8: 1: keep the visitor's robot for 10 s, in case the page is being reloaded",
    tag=0x26,
)
ALIVE = record("alive: keep-alive without content", tag=0x27)

# --- messages of the server ------------------------------------------------------------------------------------------

WELCOME = record(
    "welcome: first message to an admitted visitor",
    "visitor u32: visitor id",
    "signer b32: Ed25519 public key of updates",
    "name v8: nickname in use, UTF-8",
    tag=0x41,
)
SECRET = record(
    "secret: new resume secret; answered with `stored`",
    "secret b32: random",
    "lifetime_s u32: validity of the secret",
    tag=0x42,
)
EPOCH = record(
    "epoch: key for the updates that follow",
    "epoch u32: number of the epoch, rises",
    "counter u64: counter of the update that the chain key belongs to",
    "chain b32: chain key",
    "topic b16: topic of these updates on a broker",
    tag=0x43,
)
STANDING = record(
    "standing: current rights of the visitor",
    "role u8: 1 watch, 2 drive, 3 operate",
    "waiting u8: 1: waits for the operator's approval, without updates until then",
    "place u16: position in the queue for a robot, from 1; 0: not in the queue",
    "left_ms u32: time left of the visitor's turn; 0: no limit",
    "robot v8: address of the assigned robot, ASCII; empty: none",
    tag=0x44,
)
REPLY = record("reply: answer to a request", "number u32: number of the request", "payload rest: JSON", tag=0x45)
REFUSED = record(
    "refused: a command or request was not carried out",
    "number u32: number of the request; 0: a command",
    "reason u8: see reasons",
    tag=0x47,
)
END = record("end: the session is over", "reason u8: see ends", tag=0x48)

# --- rows of the store -----------------------------------------------------------------------------------------------

VISITOR_KEY = record("visitor_key: key of a visitor_row", "visitor u32", tag=0x61)
TICKET_KEY = record("ticket_key: key of a ticket_row", "id b8: id of the ticket's secret", tag=0x62)
DOOR_KEY = record("door_key: key of the only door_row", tag=0x63)
VISITOR_ROW = record(
    "visitor_row: a visitor that may resume",
    "role u8",
    "waiting u8: 1: waits for approval",
    "ticket b8: id of the ticket with which it joined; zeros: none",
    "secret b32: resume secret in use; zeros: a newcomer",
    "pending b32: next resume secret, not yet confirmed; zeros: none",
    "expires_s u64: Unix time",
    "name v8: UTF-8",
    "robots v16: addresses of the robots that it may drive, ASCII, a line each; empty: any",
)
TICKET_ROW = record(
    "ticket_row: a valid ticket",
    "secret b16",
    "role u8",
    "uses u32: uses left",
    "expires_s u64: Unix time",
    "name v8: UTF-8; empty: the visitor chooses",
    "robots v16: as in visitor_row",
)
DOOR_ROW = record(
    "door_row: settings of admission",
    "approval u8: 1: newcomers wait for approval",
    "next_visitor u32: next visitor id, never used twice",
)

# --- in the order of docs/spec/session.md ----------------------------------------------------------------------------

HANDSHAKE = (HELLO, SIGNED_HELLO, ACCEPT, PROLOGUE)
SEALED = (RECORD_HEAD, RECORD, UPDATE_HEAD, UPDATE, SIGNED_UPDATE, PADDED)
FROM_CLIENT = (JOIN, READY, STORED, COMMAND, LINK_REQUEST, LEAVE, ALIVE)
FROM_SERVER = (WELCOME, SECRET, EPOCH, STANDING, REPLY, REFUSED, END)
STORE = (VISITOR_KEY, TICKET_KEY, DOOR_KEY, VISITOR_ROW, TICKET_ROW, DOOR_ROW)
ON_THE_WIRE = (INVITATION, *HANDSHAKE, *SEALED, *FROM_CLIENT, *FROM_SERVER)
RECORDS = (*ON_THE_WIRE, *STORE)
