"""The byte table's page of encoded missions: what is hashed, the file, its start key, claims, and a walk's memory.

What the records leave open is behind them: `v8` and `v16` say how long it is, `count_*` how many follow.
`firmware/generate.py` makes the tables of docs/spec/mission.md from it.
"""

from __future__ import annotations

from .record import fields, record

COUNT_U8 = record("count_u8: before what follows", "count u8: of things, or of bytes")
COUNT_U16 = record("count_u16: the same", "count u16")
COUNT_U32 = record("count_u32: the same", "count u32")

# --- what is hashed ------------------------------------------------------------------------------------------------

CANONICAL = record("canonical: what is hashed", "observables rest: in the order of their tags", tag=1)
# Kinds of an observable, in the order in which they are hashed.
OF_LANDMARK, OF_POSITION, OF_SENSOR, OF_ACTION, OF_TIME, OF_MESSAGE, OF_PREVIOUS, OF_DIRECTION = range(1, 9)
OBSERVABLE = record("observable: one of what is hashed", "kind u8", "content v16")
_XY = fields("x y i32: cells from the offset")
_CELL = fields(*_XY, "bin i16: of the orientation, or -1", "area i32: in steps, or -1")
LANDMARK = record(
    "landmark: content: 0 doorway, 1 corner_convex, 2 concave_left, 3 concave_right, 4 room, 5 qr; text: its "
    "SHA3-256, if it has one",
    "type u8",
    *_CELL,
    "text rest",
)
POSITION = record("position: content: where the robot is", *_XY)
WINDOW = record("window: content: when, ⌊t / window⌋", "number i64")
DIRECTION = record("direction: content: where a way leads", "sector of u16")
NAME = record("name: of an action; of an argument; or a text that is its value", "text v8: UTF-8")
OF_NUMBER, OF_TEXT = 0, 1  # kinds of an argument
ARGUMENT = record("argument: after an argument's name: 0 a number, 1 a text", "kind u8")
NUMBER = record("number: an argument's value", "thousandths i64")

# --- the file ------------------------------------------------------------------------------------------------------

HEADER = record(
    "header: version 2; profile 0 paper, 1 sealed; flags 1 repeatable, 2 roam, 4 open start; then u8 robots, "
    "none is any, and u8 shapes (paper), each a `rising`; u32 nodes",
    "magic b4: PHXM",
    "version u8: 2",
    "profile flags u8",
    "mission_id b16",
    "valid_from_s valid_to_s u64",
    "delta_mm u16: a cell's edge",
    "heading_bins u16",
    "sectors u16: of directions",
    "window_ms u32",
    "area_cm2 u32: a step",
    "kdf_log2_n u8: scrypt's N",
    "kdf_r u8",
)
RISING = record("rising: a robot's id or a shape; of each list in rising order", "number u16")
_NODE = fields("flags u8", "timeout_s u16", "reach_dm u8", "sends u8: messages given out", "aliases u8", "ways u16")
NODE = record(
    "node: flags 1 start, 2 final, 4 join; timeout 0 is the robot's own, reach 0 any; then its aliases, its "
    "ways, and a binding of 32 bytes for each alias (paper), or visited 32 and the payload v16",
    *_NODE,
)
_OFFSET = fields(
    "offset_x_mm offset_y_mm i16: of the cells",
    "offset_turn i16: 10^-4 rad",
    "offset_area i16: 10^-2 m²",
    "apart_dm u8: to the next that looks the same, 255 is none",
)
PAPER_ALIAS = record("paper_alias: paper: one way to experience a node", "mark b32: H", *_OFFSET)
PAPER_WAY = record(
    "paper_way: paper: 0 empty, 1 direction, 2 action; then the hash of each alias, 32 bytes",
    "target u32: node",
    "kind u8",
)
SEALED_ALIAS = record("sealed_alias: sealed: the same", "mark b32: M", "secret b48")
SEALED_WAY = record("sealed_way: sealed: a way", "target u32: node", "direction b16")
SIGNED = record("signed: whether there is a signature", "signed u8: 0 no, 1 yes")
SIGNATURE = record("signature: whose, and it", "key b32: Ed25519", "signature b64")

# --- what binds, and what is sealed --------------------------------------------------------------------------------

# What the paper profile's other hashes begin with, beside CANONICAL's tag; behind the first its index.
MESSAGE, BINDING, VISITED = b"\x10message", b"\x11bind", b"\x12visited"
NTH = record("nth: in such a message's hash (paper)", "index u8: of a message that a node gives out")
BOUND = record("bound: in a paper node's binding", "node u32", "observed v16")
TRIED = record("tried: what scrypt makes of an observation", "mark b32: M", "key b32: W")
OF_NODE = record("of_node: what is sealed is bound to it", "node u32")
OF_ALIAS = record("of_alias: the same", *OF_NODE.fields, "alias u8")
OF_WAY = record("of_way: the same", *OF_NODE.fields, "target u32")
OF_SECTOR = record("of_sector: a direction, in its HMAC", "target u32", "sector u16")
PLACE = record(
    "place: a payload's: where its node is; given 0: nowhere", "given u8: 0: there is none", "x_mm y_mm i32: map frame"
)
DO = record("do: what to do there, or to get there", "action v16: empty is none")

# --- the start key -------------------------------------------------------------------------------------------------

START_KEY = record(
    "start_key: PHXK, version 2; then as many times a node u32, rising, and its gate; u16 messages",
    "magic b4: PHXK",
    "version u8",
    "mission_id b16",
    "gates u32",
)
GATE = record("gate: then its hints, one for each alias", "share b32", "hints u8")
HINT = record("hint: what to measure", "shape u16", *_OFFSET)
KEY_MESSAGE = record("key_message: then the message, 32 bytes", "name v8: UTF-8")

# --- under audit ---------------------------------------------------------------------------------------------------

CLAIM = record(
    "claim: a decoded node, as auditors are shown it; then the canonical bytes",
    "node u32",
    "alias u8",
    "shape u16",
    *_OFFSET,
    *_CELL,
    "salt v8: of the KDF (sealed)",
)
OF_READING, OF_CODE = 0, 1
SENSED = record(
    "sensed: behind a scan's ranges: 0 what another sensor read, 1 a code in the camera's picture",
    "kind u8",
    "content v16",
)
_CORNERS = fields(*(f"{axis}{k} i32: 1/64 pixel" for k in (1, 2, 3, 4) for axis in "xy"))
SEEN_CODE = record(
    "seen_code: content: corners from its top left one, as the code is read, in 1/64 pixel; text: UTF-8",
    *_CORNERS,
    "text rest",
)
WALK = record(
    "walk: no node is 0xFFFFFFFF; since NaN: not begun; then, with a u32 count each, decoded, lengths, blocked, "
    "and reported u32; then u8 heard, v8 each",
    "phase u8: seeking, returning, held, done",
    "at u32: node",
    "target u32: node",
    "t_s f64: of the last step",
    "since_s f64?: nothing was validated; NaN: not begun",
    "fixed_at_m f64: way at the last fix",
    "left_at_m f64: way at the last node",
    "pulled_x_m pulled_y_m f64: what fixes have moved since then",
    "round u8: how often blocked ways were taken up again",
)
WALK_NODE = record(
    "walk_node: decoded; no place is NaN, no landmark type 255; then its landmark, and each of its ways",
    "node u32",
    "alias u8",
    "x_m y_m f64?: NaN: it has no place",
    "type u8: of its landmark, 255 for none",
)
WALK_LANDMARK = record(
    "walk_landmark: where it truly is; no orientation is NaN",
    "x_m y_m f64",
    "orientation_rad f64?: NaN: none",
    "apart_m f64: to the next that looks the same",
    "text v16: UTF-8",
)
WALK_WAY = record("walk_way: a way on; no direction is 0xFFFF", "sector u16: 0xFFFF: none", *DO.fields)
_ENDS = fields("source u32: node", "target u32: node")
WALK_LENGTH = record("walk_length: of a way that was walked", *_ENDS, "length_m f64")
WALK_BLOCKED = record("walk_blocked: a way that timed out or was blocked", *_ENDS)

# --- in the order of docs/spec/mission.md --------------------------------------------------------------------------

HASHED = (CANONICAL, OBSERVABLE, LANDMARK, POSITION, WINDOW, DIRECTION, NAME, ARGUMENT, NUMBER)
FILE = (HEADER, RISING, NODE, PAPER_ALIAS, PAPER_WAY, SEALED_ALIAS, SEALED_WAY, SIGNED, SIGNATURE)
SEALED = (NTH, BOUND, TRIED, OF_NODE, OF_ALIAS, OF_WAY, OF_SECTOR, PLACE, DO)
KEY = (START_KEY, GATE, HINT, KEY_MESSAGE)
WALKED = (WALK, WALK_NODE, WALK_LANDMARK, WALK_WAY, WALK_LENGTH, WALK_BLOCKED)
RECORDS = (COUNT_U8, COUNT_U16, COUNT_U32, *HASHED, *FILE, *SEALED, *KEY, CLAIM, *WALKED)
