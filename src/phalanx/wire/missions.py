"""The byte table's page of encoded missions: what is hashed, the file, its start key, claims, and a walk's memory.

What the records leave open is behind them: `v8` and `v16` say how long it is, `count_*` how many follow.
`firmware/generate.py` makes the tables of docs/spec/mission.md from it.
"""

from __future__ import annotations

from .record import Field, Record

COUNT_U8 = Record("count_u8", (Field("count", "u8", "of things, or of bytes"),), "before what follows")
COUNT_U16 = Record("count_u16", (Field("count", "u16", ""),), "the same")
COUNT_U32 = Record("count_u32", (Field("count", "u32", ""),), "the same")

# --- what is hashed ------------------------------------------------------------------------------------------------

CANONICAL = Record("canonical", (Field("observables", "rest", "in the order of their tags"),), "what is hashed", 1)
# Kinds of an observable, in the order in which they are hashed.
OF_LANDMARK, OF_POSITION, OF_SENSOR, OF_ACTION, OF_TIME, OF_MESSAGE, OF_PREVIOUS, OF_DIRECTION = range(1, 9)
OBSERVABLE = Record("observable", (Field("kind", "u8", ""), Field("content", "v16", "")), "one of what is hashed")
_XY = (Field("x", "i32", "cells from the offset"), Field("y", "i32", ""))
_CELL = (*_XY, Field("bin", "i16", "of the orientation, or -1"), Field("area", "i32", "in steps, or -1"))
LANDMARK = Record(
    "landmark",
    (Field("type", "u8", ""), *_CELL, Field("text", "rest", "")),
    "content: 0 doorway, 1 corner_convex, 2 concave_left, 3 concave_right, 4 room, 5 qr; "
    "text: its SHA3-256, if it has one",
)
POSITION = Record("position", _XY, "content: where the robot is")
WINDOW = Record("window", (Field("number", "i64", ""),), "content: when, ⌊t / window⌋")
DIRECTION = Record("direction", (Field("sector", "u16", ""), Field("of", "u16", "")), "content: where a way leads")
NAME = Record("name", (Field("text", "v8", "UTF-8"),), "of an action; of an argument; or a text that is its value")
OF_NUMBER, OF_TEXT = 0, 1  # kinds of an argument
ARGUMENT = Record("argument", (Field("kind", "u8", ""),), "after an argument's name: 0 a number, 1 a text")
NUMBER = Record("number", (Field("thousandths", "i64", ""),), "an argument's value")

# --- the file ------------------------------------------------------------------------------------------------------

HEADER = Record(
    "header",
    (
        Field("magic", "b4", "PHXM"),
        Field("version", "u8", "2"),
        Field("profile", "u8", ""),
        Field("flags", "u8", ""),
        Field("mission_id", "b16", ""),
        Field("valid_from_s", "u64", ""),
        Field("valid_to_s", "u64", ""),
        Field("delta_mm", "u16", "a cell's edge"),
        Field("heading_bins", "u16", ""),
        Field("sectors", "u16", "of directions"),
        Field("window_ms", "u32", ""),
        Field("area_cm2", "u32", "a step"),
        Field("kdf_log2_n", "u8", "scrypt's N"),
        Field("kdf_r", "u8", ""),
    ),
    "version 2; profile 0 paper, 1 sealed; flags 1 repeatable, 2 roam, 4 open start; then u8 robots, none is any, and "
    "u8 shapes (paper), each a `rising`; u32 nodes",
)
RISING = Record("rising", (Field("number", "u16", ""),), "a robot's id or a shape; of each list in rising order")
_NODE = (
    Field("flags", "u8", ""),
    Field("timeout_s", "u16", ""),
    Field("reach_dm", "u8", ""),
    Field("sends", "u8", "messages given out"),
    Field("aliases", "u8", ""),
    Field("ways", "u16", ""),
)
NODE = Record(
    "node",
    _NODE,
    "flags 1 start, 2 final, 4 join; timeout 0 is the robot's own, reach 0 any; then its aliases, its ways, "
    "and a binding of 32 bytes for each alias (paper), or visited 32 and the payload v16",
)
_OFFSET = (
    Field("offset_x_mm", "i16", "of the cells"),
    Field("offset_y_mm", "i16", ""),
    Field("offset_turn", "i16", "10^-4 rad"),
    Field("offset_area", "i16", "10^-2 m²"),
    Field("apart_dm", "u8", "to the next that looks the same, 255 is none"),
)
PAPER_ALIAS = Record("paper_alias", (Field("mark", "b32", "H"), *_OFFSET), "paper: one way to experience a node")
PAPER_WAY = Record(
    "paper_way",
    (Field("target", "u32", "node"), Field("kind", "u8", "")),
    "paper: 0 empty, 1 direction, 2 action; then the hash of each alias, 32 bytes",
)
SEALED_ALIAS = Record("sealed_alias", (Field("mark", "b32", "M"), Field("secret", "b48", "")), "sealed: the same")
SEALED_WAY = Record("sealed_way", (Field("target", "u32", "node"), Field("direction", "b16", "")), "sealed: a way")
SIGNED = Record("signed", (Field("signed", "u8", "0 no, 1 yes"),), "whether there is a signature")
SIGNATURE = Record("signature", (Field("key", "b32", "Ed25519"), Field("signature", "b64", "")), "whose, and it")

# --- what binds, and what is sealed --------------------------------------------------------------------------------

# What the paper profile's other hashes begin with, beside CANONICAL's tag; behind the first its index.
MESSAGE, BINDING, VISITED = b"\x10message", b"\x11bind", b"\x12visited"
NTH = Record("nth", (Field("index", "u8", "of a message that a node gives out"),), "in such a message's hash (paper)")
BOUND = Record("bound", (Field("node", "u32", ""), Field("observed", "v16", "")), "in a paper node's binding")
TRIED = Record("tried", (Field("mark", "b32", "M"), Field("key", "b32", "W")), "what scrypt makes of an observation")
OF_NODE = Record("of_node", (Field("node", "u32", ""),), "what is sealed is bound to it")
OF_ALIAS = Record("of_alias", (*OF_NODE.fields, Field("alias", "u8", "")), "the same")
OF_WAY = Record("of_way", (*OF_NODE.fields, Field("target", "u32", "")), "the same")
OF_SECTOR = Record("of_sector", (Field("target", "u32", ""), Field("sector", "u16", "")), "a direction, in its HMAC")
PLACE = Record(
    "place",
    (Field("given", "u8", "0: there is none"), Field("x_mm", "i32", "map frame"), Field("y_mm", "i32", "")),
    "a payload's: where its node is; given 0: nowhere",
)
DO = Record("do", (Field("action", "v16", "empty is none"),), "what to do there, or to get there")

# --- the start key -------------------------------------------------------------------------------------------------

START_KEY = Record(
    "start_key",
    (
        Field("magic", "b4", "PHXK"),
        Field("version", "u8", ""),
        Field("mission_id", "b16", ""),
        Field("gates", "u32", ""),
    ),
    "PHXK, version 2; then as many times a node u32, rising, and its gate; u16 messages",
)
GATE = Record("gate", (Field("share", "b32", ""), Field("hints", "u8", "")), "then its hints, one for each alias")
HINT = Record("hint", (Field("shape", "u16", ""), *_OFFSET), "what to measure")
KEY_MESSAGE = Record("key_message", (Field("name", "v8", "UTF-8"),), "then the message, 32 bytes")

# --- under audit ---------------------------------------------------------------------------------------------------

CLAIM = Record(
    "claim",
    (
        Field("node", "u32", ""),
        Field("alias", "u8", ""),
        Field("shape", "u16", ""),
        *_OFFSET,
        *_CELL,
        Field("salt", "v8", "of the KDF (sealed)"),
    ),
    "a decoded node, as auditors are shown it; then the canonical bytes",
)
OF_READING, OF_CODE = 0, 1
SENSED = Record(
    "sensed",
    (Field("kind", "u8", ""), Field("content", "v16", "")),
    "behind a scan's ranges: 0 what another sensor read, 1 a code in the camera's picture",
)
_CORNERS = tuple(Field(f"{axis}{k}", "i32", "1/64 pixel") for k in (1, 2, 3, 4) for axis in "xy")
SEEN_CODE = Record(
    "seen_code",
    (*_CORNERS, Field("text", "rest", "")),
    "content: corners from its top left one, as the code is read, in 1/64 pixel; text: UTF-8",
)
WALK = Record(
    "walk",
    (
        Field("phase", "u8", "seeking, returning, held, done"),
        Field("at", "u32", "node"),
        Field("target", "u32", "node"),
        Field("t_s", "f64", "of the last step"),
        Field("since_s", "f64?", "nothing was validated; NaN: not begun"),
        Field("fixed_at_m", "f64", "way at the last fix"),
        Field("left_at_m", "f64", "way at the last node"),
        Field("pulled_x_m", "f64", "what fixes have moved since then"),
        Field("pulled_y_m", "f64", ""),
        Field("round", "u8", "how often blocked ways were taken up again"),
    ),
    "no node is 0xFFFFFFFF; since NaN: not begun; then, with a u32 count each, decoded, lengths, blocked, and "
    "reported u32; then u8 heard, v8 each",
)
WALK_NODE = Record(
    "walk_node",
    (
        Field("node", "u32", ""),
        Field("alias", "u8", ""),
        Field("x_m", "f64?", "NaN: it has no place"),
        Field("y_m", "f64?", ""),
        Field("type", "u8", "of its landmark, 255 for none"),
    ),
    "decoded; no place is NaN, no landmark type 255; then its landmark, and each of its ways",
)
WALK_LANDMARK = Record(
    "walk_landmark",
    (
        Field("x_m", "f64", ""),
        Field("y_m", "f64", ""),
        Field("orientation_rad", "f64?", "NaN: none"),
        Field("apart_m", "f64", "to the next that looks the same"),
        Field("text", "v16", "UTF-8"),
    ),
    "where it truly is; no orientation is NaN",
)
WALK_WAY = Record("walk_way", (Field("sector", "u16", "0xFFFF: none"), *DO.fields), "a way on; no direction is 0xFFFF")
_ENDS = (Field("source", "u32", "node"), Field("target", "u32", "node"))
WALK_LENGTH = Record("walk_length", (*_ENDS, Field("length_m", "f64", "")), "of a way that was walked")
WALK_BLOCKED = Record("walk_blocked", _ENDS, "a way that timed out or was blocked")

# --- in the order of docs/spec/mission.md --------------------------------------------------------------------------

HASHED = (CANONICAL, OBSERVABLE, LANDMARK, POSITION, WINDOW, DIRECTION, NAME, ARGUMENT, NUMBER)
FILE = (HEADER, RISING, NODE, PAPER_ALIAS, PAPER_WAY, SEALED_ALIAS, SEALED_WAY, SIGNED, SIGNATURE)
SEALED = (NTH, BOUND, TRIED, OF_NODE, OF_ALIAS, OF_WAY, OF_SECTOR, PLACE, DO)
KEY = (START_KEY, GATE, HINT, KEY_MESSAGE)
WALKED = (WALK, WALK_NODE, WALK_LANDMARK, WALK_WAY, WALK_LENGTH, WALK_BLOCKED)
RECORDS = (COUNT_U8, COUNT_U16, COUNT_U32, *HASHED, *FILE, *SEALED, *KEY, CLAIM, *WALKED)
