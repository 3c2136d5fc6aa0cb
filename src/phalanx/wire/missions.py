"""Records of encoded missions: hashed observables, file, start key, claims, a walk's state. Part of the byte table.

Parts of variable length follow their record: `v8` and `v16` begin with a length, `count_*` is a number of items.
`firmware/generate.py` writes the tables of docs/spec/mission.md from this file.
"""

from __future__ import annotations

from .record import fields, record

COUNT_U8 = record("count_u8: number of the items or bytes that follow", "count u8: items or bytes")
COUNT_U16 = record("count_u16: the same, 16 bits", "count u16")
COUNT_U32 = record("count_u32: the same, 32 bits", "count u32")

# --- what is hashed ------------------------------------------------------------------------------------------------

CANONICAL = record("canonical: hashed bytes of a node", "observables rest: by rising kind", tag=1)
# Kinds of an observable, in the order in which they are hashed.
OF_LANDMARK, OF_POSITION, OF_SENSOR, OF_ACTION, OF_TIME, OF_MESSAGE, OF_PREVIOUS, OF_DIRECTION = range(1, 9)
OBSERVABLE = record("observable: one observable among the hashed bytes", "kind u8", "content v16")
_XY = fields("x y i32: cells from the offset")
_CELL = fields(*_XY, "bin i16: bin of the orientation, or -1", "area i32: in steps, or -1")
LANDMARK = record(
    "landmark: content: 0 doorway, 1 corner_convex, 2 concave_left, 3 concave_right, 4 room, 5 qr; text: SHA3-256 "
    "of the landmark's text, if it has one",
    "type u8",
    *_CELL,
    "text rest",
)
POSITION = record("position: content: the robot's position", *_XY)
WINDOW = record("window: content: time window, ⌊t / window⌋", "number i64")
DIRECTION = record("direction: content: direction of a way", "sector of u16")
NAME = record("name: name of an action or argument, or an argument's text value", "text v8: UTF-8")
OF_NUMBER, OF_TEXT = 0, 1  # kinds of an argument
ARGUMENT = record("argument: follows an argument's name; kind of its value: 0 a number, 1 a text", "kind u8")
NUMBER = record("number: an argument's value", "thousandths i64")

# --- the file ------------------------------------------------------------------------------------------------------

HEADER = record(
    "header: version 2; profile 0 paper, 1 sealed; flags 1 repeatable, 2 roam, 4 open start; then a u8 count of "
    "robots (0: any) and a u8 count of shapes (paper), each followed by as many `rising`; then a u32 count of nodes",
    "magic b4: PHXM",
    "version u8: 2",
    "profile flags u8",
    "mission_id b16",
    "valid_from_s valid_to_s u64",
    "delta_mm u16: edge of a cell",
    "heading_bins u16",
    "sectors u16: number of sectors of directions",
    "window_ms u32",
    "area_cm2 u32: step of areas",
    "kdf_log2_n u8: log2 of scrypt's N",
    "kdf_r u8",
)
RISING = record("rising: a robot id or a shape; each list in rising order", "number u16")
_NODE = fields("flags u8", "timeout_s u16", "reach_dm u8", "sends u8: messages it sends", "aliases u8", "ways u16")
NODE = record(
    "node: flags 1 start, 2 final, 4 join; timeout 0: the robot's default; reach 0: any distance; then its aliases, "
    "its ways, and in `paper` a binding of 32 bytes for each alias, in `sealed` visited (32 bytes) and the payload v16",
    *_NODE,
)
_OFFSET = fields(
    "offset_x_mm offset_y_mm i16: offset of the cells",
    "offset_turn i16: 10^-4 rad",
    "offset_area i16: 10^-2 m²",
    "apart_dm u8: distance to the nearest landmark that looks the same, 255: none",
)
PAPER_ALIAS = record("paper_alias: paper: one set of observables that decodes a node", "mark b32: H", *_OFFSET)
PAPER_WAY = record(
    "paper_way: paper: a way to another node: 0 empty, 1 direction, 2 action; then the hash of each alias, 32 bytes",
    "target u32: node",
    "kind u8",
)
SEALED_ALIAS = record("sealed_alias: sealed: the same as paper_alias", "mark b32: M", "secret b48")
SEALED_WAY = record("sealed_way: sealed: a way to another node", "target u32: node", "direction b16")
SIGNED = record("signed: flag: a signature follows", "signed u8: 0 no, 1 yes")
SIGNATURE = record("signature: the author's public key and signature", "key b32: Ed25519", "signature b64")

# --- what binds, and what is sealed --------------------------------------------------------------------------------

# Prefixes of the paper profile's other hashes, which CANONICAL's tag does not begin. `NTH` follows MESSAGE.
MESSAGE, BINDING, VISITED = b"\x10message", b"\x11bind", b"\x12visited"
NTH = record("nth: paper: part of a message's hash", "index u8: index of the message among those of its node")
BOUND = record("bound: paper: hashed for a node's binding", "node u32", "observed v16")
TRIED = record("tried: output of scrypt for an observation", "mark b32: M", "key b32: W")
OF_NODE = record("of_node: number of a node; also binds its sealed payload to it", "node u32")
OF_ALIAS = record("of_alias: an alias; binds what is sealed for it", *OF_NODE.fields, "alias u8")
OF_WAY = record("of_way: a way; binds its sealed direction", *OF_NODE.fields, "target u32")
OF_SECTOR = record("of_sector: a direction, as input of its HMAC", "target u32", "sector u16")
PLACE = record(
    "place: in a payload: position of the node", "given u8: 1; 0: it has no position", "x_mm y_mm i32: map frame"
)
DO = record("do: action at the node, or action that leads there", "action v16: empty: none")

# --- the start key -------------------------------------------------------------------------------------------------

START_KEY = record(
    "start_key: PHXK, version 2; then for each gate a node u32, rising, and the gate; then a u16 count of messages",
    "magic b4: PHXK",
    "version u8",
    "mission_id b16",
    "gates u32",
)
GATE = record("gate: secret share of a node; then its hints, one for each alias", "share b32", "hints u8")
HINT = record("hint: shape and offsets of the measurement for an alias", "shape u16", *_OFFSET)
KEY_MESSAGE = record("key_message: name of a message; then the message, 32 bytes", "name v8: UTF-8")

# --- under audit ---------------------------------------------------------------------------------------------------

CLAIM = record(
    "claim: evidence to auditors that a node was decoded; then the canonical bytes",
    "node u32",
    "alias u8",
    "shape u16",
    *_OFFSET,
    *_CELL,
    "salt v8: salt of the KDF (sealed)",
)
OF_READING, OF_CODE = 0, 1
SENSED = record(
    "sensed: after a scan's ranges: 0 a reading of another sensor, 1 a code in the camera's picture",
    "kind u8",
    "content v16",
)
_CORNERS = fields(*(f"{axis}{k} i32: 1/64 pixel" for k in (1, 2, 3, 4) for axis in "xy"))
SEEN_CODE = record(
    "seen_code: content: corners, beginning at the upright code's top left one, in 1/64 pixel; text: UTF-8",
    *_CORNERS,
    "text rest",
)
WALK = record(
    "walk: state of a robot's walk; node 0xFFFFFFFF: none; then, each with a u32 count: decoded, lengths, blocked, "
    "reported (u32); then a u8 count of received messages, v8 each",
    "phase u8: seeking, returning, held, done",
    "at u32: node",
    "target u32: node",
    "t_s f64: time of the last step",
    "since_s f64?: start of the time in which no node was validated; NaN: not begun",
    "fixed_at_m f64: distance travelled at the last fix",
    "left_at_m f64: distance travelled at the last node",
    "pulled_x_m pulled_y_m f64: correction of the pose by fixes since the last node",
    "round u8: how many times blocked ways were tried again",
)
WALK_NODE = record(
    "walk_node: a decoded node; then its landmark, if it has one, and each of its ways",
    "node u32",
    "alias u8",
    "x_m y_m f64?: position; NaN: none",
    "type u8: type of its landmark; 255: none",
)
WALK_LANDMARK = record(
    "walk_landmark: true position of a landmark",
    "x_m y_m f64",
    "orientation_rad f64?: NaN: none",
    "apart_m f64: distance to the nearest landmark that looks the same",
    "text v16: UTF-8",
)
WALK_WAY = record("walk_way: a way from a decoded node", "sector u16: direction; 0xFFFF: none", *DO.fields)
_ENDS = fields("source u32: node", "target u32: node")
WALK_LENGTH = record("walk_length: length of a way that the robot has travelled", *_ENDS, "length_m f64")
WALK_BLOCKED = record("walk_blocked: a way that timed out or was blocked", *_ENDS)

# --- in the order of docs/spec/mission.md --------------------------------------------------------------------------

HASHED = (CANONICAL, OBSERVABLE, LANDMARK, POSITION, WINDOW, DIRECTION, NAME, ARGUMENT, NUMBER)
FILE = (HEADER, RISING, NODE, PAPER_ALIAS, PAPER_WAY, SEALED_ALIAS, SEALED_WAY, SIGNED, SIGNATURE)
SEALED = (NTH, BOUND, TRIED, OF_NODE, OF_ALIAS, OF_WAY, OF_SECTOR, PLACE, DO)
KEY = (START_KEY, GATE, HINT, KEY_MESSAGE)
WALKED = (WALK, WALK_NODE, WALK_LANDMARK, WALK_WAY, WALK_LENGTH, WALK_BLOCKED)
RECORDS = (COUNT_U8, COUNT_U16, COUNT_U32, *HASHED, *FILE, *SEALED, *KEY, CLAIM, *WALKED)
