"""THE byte table: the only place that knows a width, an order or a tag; the modules beside it are its pages.

`firmware/generate.py` makes firmware/include/phx_wire.h and the tables of docs/spec/rebound*.md from it. Kernels take
offsets from it as constants of their modules (`AT_MAC = AUDIT_TOKEN.at("mac")`), which compile to literals.
Integers are little-endian. A robot id is a u16, 0 is none. `t` is a trusted node's own clock in ms since power-up.
Source: RoboRebound Alg. 2-4 (what is hashed and MACed) and §5.2 (27 and 19 byte payloads, 7 bytes over each entry).
"""

from __future__ import annotations

from . import driven, guarded, lines, missions
from .record import Field, Record

HASH_BYTES = 20  # SHA-1
MAC_BYTES = 8  # LightMAC over PRESENT-80
KEY_BYTES = 20  # K1 ‖ K2, as long as a hash: the mission key is blinded with one
NONCE_BYTES = 8  # the MAC of the token request that an authenticator answers
FRAME_MAX = 2048  # of a frame, a sensor reading or an actuator command, bytes

# --- entries of the two chains -----------------------------------------------------------------------------------

ENTRY_INPUT = 1  # s-chain: what a sensor said
ENTRY_RECV = 2  # a-chain: a frame from the radio
ENTRY_SEND = 3  # a-chain: a frame to the radio
ENTRY_ACMD = 4  # a-chain: a command to the actuators

ENTRY = Record(
    "entry",
    (
        Field("type", "u8", "1 INPUT, 2 RECV, 3 SEND, 4 ACMD"),
        Field("t", "u32", "ms, clock of the node that chained it"),
        Field("payload", "v16", "u16 length, then the reading, the whole frame or the command"),
    ),
    "what is chained and what the c-node logs",
)
ENTRY_HEADER_BYTES = ENTRY.size

# --- beside entries in a c-node's log, in no chain -----------------------------------------------------------------

MARK = 0x80  # the bit that tells them from entries
MARK_FLUSH_S = 0x81
MARK_FLUSH_A = 0x82
MARK_CHECKPOINT = 0x83
MARK_EVIDENCE = 0x84

FLUSHED_S = Record("flushed_s", (), "the s-chain was flushed here before its batch was full", MARK_FLUSH_S)
FLUSHED_A = Record("flushed_a", (), "the a-chain was", MARK_FLUSH_A)
CHECKED = Record("checked", (), "the checkpoint was taken here", MARK_CHECKPOINT)
EVIDENCE = Record(
    "evidence",
    (Field("bytes", "v16", "u16 length, then what the controller keeps of a reading"),),
    "of the INPUT right before it",
    MARK_EVIDENCE,
)

# --- frames and payloads -------------------------------------------------------------------------------------------

KIND_STATE = 0x01
KIND_SENSOR = 0x02
KIND_ACCELERATION = 0x03
KIND_WHEELS_COMMAND = 0x05
KIND_WHEELS_SENSOR = 0x06
KIND_WHEELS_STATE = 0x07
KIND_MISSION_READING = 0x08
KIND_MISSION_MESSAGE = 0x09
KIND_DRIVE = 0x0A
KIND_ACTION = 0x0B
KIND_AUDIT = 0x80  # the bit that keeps a frame out of the chains

_SAID = (Field("id", "u16", "robot id"), Field("t", "u64", "ms, sender's clock"))
_MOTION = (
    Field("x_m", "f32", "position, world frame"),
    Field("y_m", "f32", ""),
    Field("vx_mps", "f32", "velocity, world frame"),
    Field("vy_mps", "f32", ""),
)
STATE = Record("state", (*_SAID, *_MOTION), "broadcast: where a robot is and where it goes", KIND_STATE)
SENSOR = Record("sensor", (*_SAID, *_MOTION), "reading of the position sensor", KIND_SENSOR)
ACCELERATION = Record(
    "acceleration",
    (*_SAID, Field("ax_mps2", "f32", "acceleration, world frame"), Field("ay_mps2", "f32", "")),
    "command to the actuators",
    KIND_ACCELERATION,
)

# Robots that visitors drive (docs/spec/vocabulary.md): x to the right, y down.
WHEELS_COMMAND = Record(
    "wheels_command", (*_SAID, *driven.WHEELS, *driven.LED), "command to wheels and LED", KIND_WHEELS_COMMAND
)
WHEELS_SENSOR = Record("wheels_sensor", (*_SAID, *driven.POSE), "reading of the pose sensor", KIND_WHEELS_SENSOR)
WHEELS_STATE = Record(
    "wheels_state",
    (*_SAID, *driven.POSE, *driven.LED),
    "broadcast: where a driven robot is and how it shines",
    KIND_WHEELS_STATE,
)

# Robots on encoded missions (docs/spec/mission.md).
RANGE = Field("range", "u16", "mm; 0 says nothing, 0xFFFF a miss")
MISSION_READING = Record(
    "mission_reading",
    (
        *_SAID,
        Field("x", "i32", "0.1 mm, odometry's own frame, never corrected"),
        Field("y", "i32", ""),
        Field("heading", "i32", "µrad, the same frame"),
        Field("travelled_mm", "u32", "since the start, forwards and backwards"),
        Field("scan_sha1", "b20", "of the scan, a range for each beam, and what other sensors read"),
        Field("clear", "rest", "a byte for each sector: the nearest hit, in steps of 2 cm, 255 from 5.1 m on"),
    ),
    "reading of a mission robot's odometry and lidar",
    KIND_MISSION_READING,
)
MISSION_MESSAGE = Record(
    "mission_message",
    (Field("id", "u16", "robot id"), Field("message", "b32", "encoded message of the mission")),
    "broadcast, again and again: what a decoded node gives out",
    KIND_MISSION_MESSAGE,
)
DRIVE = Record(
    "drive",
    (*_SAID, Field("speed_mmps", "i16", ""), Field("turn_mradps", "i16", "")),
    "command to a mission robot's wheels",
    KIND_DRIVE,
)
ACTION = Record(
    "action",
    (*_SAID, Field("action", "rest", "the action's canonical bytes")),
    "command: what a decoded node has the robot do",
    KIND_ACTION,
)

HELLO = 0
FRAGMENT = 1
TOKEN_REPLY = 2
SEEK = 3

_AUDIT = (Field("src", "u16", "robot id; in `bound` written by the a-node"), Field("dst", "u16", "robot id, 0 for all"))
AUDIT_HELLO = Record("audit_hello", (*_AUDIT, Field("sub", "u8", "", HELLO)), "here is somebody who audits", KIND_AUDIT)
AUDIT_SEEK = Record(
    "audit_seek", (*_AUDIT, Field("sub", "u8", "", SEEK)), "a hello that each who hears it answers with one", KIND_AUDIT
)
AUDIT_FRAGMENT = Record(
    "audit_fragment",
    (
        *_AUDIT,
        Field("sub", "u8", "", FRAGMENT),
        Field("request", "u16", "number of the request, auditee's"),
        Field("index", "u8", "of this fragment, from 0"),
        Field("count", "u8", "of fragments"),
        Field("bytes", "rest", "piece of the request"),
    ),
    "a piece of a request for an audit",
    KIND_AUDIT,
)
AUDIT_TOKEN = Record(
    "audit_token",
    (
        *_AUDIT,
        Field("sub", "u8", "", TOKEN_REPLY),
        Field("request", "u16", "the number that the request had"),
        Field("t", "u32", "ms, auditee's a-node clock at the request"),
        Field("mac", "b8", "of the token"),
    ),
    "the auditor's answer",
    KIND_AUDIT,
)
AUDIT_HEADER_BYTES = AUDIT_HELLO.size

# --- what is MACed -------------------------------------------------------------------------------------------------

MKEY = Record(
    "mkey",
    (Field("k", "b20", "mission key XOR H(r ‖ master key)"), Field("r", "b20", "random"), Field("seq", "u32", "rises")),
    "mission key, under the master key",
    0x10,
)
_AUTH = (Field("thash", "b20", "top of the chain"), Field("id", "u16", "robot id"))
_NONCE = Field("nonce", "b8", "MAC of the token request")
AUTH_S = Record("auth_s", (*_AUTH, _NONCE), "authenticator of an s-node", 0x11)
AUTH_S_PAPER = Record("auth_s_paper", _AUTH, "the same in profile `paper`", 0x11)
AUTH_A_PAPER = Record("auth_a_paper", _AUTH, "authenticator of an a-node; in profile `paper` only", 0x12)
_TREQ = (
    Field("t", "u32", "ms, auditee's a-node clock"),
    Field("tee", "u16", "auditee"),
    Field("tor", "u16", "auditor"),
)
TREQ = Record("treq", (*_TREQ, Field("thash_a", "b20", "top of the a-chain, just flushed")), "token request", 0x13)
TREQ_PAPER = Record("treq_paper", _TREQ, "the same in profile `paper`", 0x13)
TOKEN = Record(
    "token",
    (
        Field("tor", "u16", "auditor"),
        Field("tee", "u16", "auditee"),
        Field("t", "u32", "ms, of the request"),
        Field("hckpt", "b20", "hash of the checkpoint that was audited"),
    ),
    "an auditor's word that it replayed the log and found no fault",
    0x14,
)
_SENDER = (Field("t", "u32", "ms, sender's a-node clock; no two frames have the same"), Field("src", "u16", "robot id"))
SEALED = Record("sealed", (*_SENDER, Field("hash", "b20", "of the frame")), "a frame on a sealed radio", 0x15)

# --- what trusted nodes hand out -----------------------------------------------------------------------------------

BOARD = Record(
    "board",
    (Field("id", "u16", "robot id"), Field("master", "b20", "master key")),
    "what trusted nodes are given when they are made",
)
AUTHENTICATOR = Record(
    "authenticator",
    (Field("top", "b20", "of the chain, just flushed"), Field("id", "u16", "robot id"), Field("mac", "b8", "")),
    "from make authenticator",
)
TOKEN_REQUEST = Record(
    "token_request",
    (
        Field("t", "u32", "ms, auditee's a-node clock"),
        Field("top", "b20", "of the a-chain, just flushed; zeros in profile `paper`"),
        Field("mac", "b8", ""),
    ),
    "from make token request",
)
SEAL = Record("seal", (*_SENDER, Field("mac", "b8", "of `sealed`")), "behind each frame on a sealed radio")

# --- what an auditee shows -----------------------------------------------------------------------------------------

REQUEST_VERSION = 0x01

REQUEST = Record(
    "request",
    (
        Field("flags", "u8", "1: the log begins at boot"),
        Field("tee", "u16", "auditee"),
        Field("t", "u32", "ms, of the token request"),
        Field("top_a", "b20", "top of the a-chain"),
        Field("treq_mac", "b8", "of the token request"),
        Field("top_s", "b20", "top of the s-chain"),
        Field("auth_s_mac", "b8", "of its authenticator"),
        Field("auth_a_mac", "b8", "of the a-node's, in `paper` only"),
        Field("hckpt", "b20", "hash of the checkpoint claimed"),
        Field("tokens", "u8", "that cover the start"),
        Field("start_length", "u16", "of the start"),
        Field("segment_length", "u32", "of the log"),
        Field("shown", "rest", "covering tokens, start, segment of the log"),
    ),
    "request for an audit; the tag is its version",
    REQUEST_VERSION,
)
COVERING_TOKEN = Record(
    "covering_token",
    (Field("tor", "u16", "auditor"), Field("t", "u32", "ms, of its request"), Field("mac", "b8", "")),
    "an auditor's word for the start",
)
BOOTED = Record(
    "booted", (Field("t_key", "u32", "ms, when the mission key was loaded"),), "the start of a log that begins at boot"
)
CHECKPOINT = Record(
    "checkpoint",
    (
        Field("t", "u32", "ms, when the next INPUT is due"),
        Field("step", "u32", "its number"),
        Field("top_s", "b20", "top of the s-chain"),
        Field("top_a", "b20", "top of the a-chain"),
        Field("state", "rest", "the controller's memory"),
    ),
    "any other start; what tokens cover the hash of",
)

KEPT = Record(
    "kept",
    (Field("claims", "u8", "0 or 1"), Field("shown", "rest", "it, then the scan's differences, or nothing")),
    "evidence of a mission robot's",
)
PROOF = Record(
    "proof",
    (
        Field("tor", "u16", "whom a request asked"),
        Field("head", f"b{REQUEST.size}", "what it begins with"),
    ),
    "in a robot's kept log: what its trusted nodes said of all that stands before",
    0x86,
)
KEPT_CLAIM = Record("kept_claim", (Field("claim", "v16", "u16 length, then the claim"),), "what the scan is to show")

# --- what is between controllers and their c-node, and what they remember ------------------------------------------

OUTPUT = Record(
    "output",
    (Field("type", "u8", "3 SEND, 4 ACMD"), Field("payload", "v16", "u16 length, then the frame or the command")),
    "what a controller puts out",
)
FLOCK_MEMORY = Record(
    "flock_memory",
    (*_MOTION, Field("count", "u16", "of neighbours"), Field("neighbours", "rest", "as many, by rising id")),
    "what a flock's controller remembers",
)
NEIGHBOUR = Record(
    "neighbour",
    (Field("id", "u16", "robot id"), Field("heard", "u64", "ms, own a-node's clock"), *_MOTION),
    "a robot that was heard",
)
MISSION_MEMORY = Record(
    "mission_memory",
    (
        Field("begun", "u64", "ms, s-node's clock at the first reading; 0 before"),
        Field("x_m", "f64", "where it believes to be, map frame"),
        Field("y_m", "f64", ""),
        Field("heading_rad", "f64", ""),
        Field("way", "f64", "what its odometry leaves out, of the way"),
        Field("turn", "f64", "of turns"),
        Field("curve", "f64", "rad a metre"),
        *(Field(f"spread_{i}{j}", "f64", "" if i + j else "their covariance") for i in range(6) for j in range(i, 6)),
        Field("odometry_x_m", "f64", "by the last reading, its own frame"),
        Field("odometry_y_m", "f64", ""),
        Field("odometry_rad", "f64", ""),
        Field("kind", "i8", "of the instruction in hand, -1 for none"),
        Field("target", "i64", "node, or -1"),
        Field("begin", "i64", "node, or -1"),
        Field("passed", "u8", "1: the place where it begins lies behind"),
        Field("best_m", "f64", "least way that was left"),
        Field("best_s", "f64", "when that was"),
        Field("turning", "i8", "1, -1: it turns about, to the left or to the right; 2, -2: it has; 0: never yet"),
        Field("stop_x_cm", "i32", "next place on a way around, odometry's frame; both -2^31: none"),
        Field("stop_y_cm", "i32", ""),
        Field("base_x", "i32", "number of the first cell around, odometry's frame"),
        Field("base_y", "i32", ""),
        Field("seen_s", "f64", "when it last looked"),
        Field("waited_s", "f64", "before a long way around"),
        Field("cells", "b576", "2 bits for each of 48 x 48 cells of 0.125 m: 3, hit; less every 4 s; 0: nothing"),
        Field("blocked", "u8", "1: the way was given up at the last step"),
        Field("said", "u8", "messages that it gives out"),
        Field("crumbs", "u8", "places of the way here that it remembers"),
        Field("rest", "rest", "messages, 32 bytes each; crumbs; then the walk (docs/spec/mission.md)"),
    ),
    "what a mission robot's controller remembers",
)
CRUMB = Record(
    "crumb",
    (Field("x_cm", "i32", "map frame"), Field("y_cm", "i32", "")),
    "a place of the way back",
)

# --- what pages are told -------------------------------------------------------------------------------------------

TURN_DEG = 360
PASS_BY = 181  # so many numbers are left out by a record that is no robot
ROBOT_PLACE = Record(
    "robot_place",
    (
        Field("w", "u16", "TURN_DEG · (how many numbers are left out before this one) + direction, whole degrees"),
        Field("x", "u16", "in the piece's steps from its left"),
        Field("y", "u16", "from its top"),
    ),
    "where a robot is, in a frame; with a w of 181 · 360 or more it is no robot, and leaves out 181 numbers",
)

# --- spaces in which a first byte is one record's ------------------------------------------------------------------

LOGGED = (FLUSHED_S, FLUSHED_A, CHECKED, EVIDENCE, guarded.ADVICE)  # beside ENTRY, whose first byte is its type
DRIVEN = (*driven.ORDERS, WHEELS_COMMAND, WHEELS_SENSOR, WHEELS_STATE)
ON_MISSION = (MISSION_READING, MISSION_MESSAGE, DRIVE, ACTION)
ADVISED = (guarded.WISH, guarded.SIGNED_WISH)
AUDITS = (AUDIT_HELLO, AUDIT_SEEK, AUDIT_FRAGMENT, AUDIT_TOKEN)
PAYLOADS = (STATE, SENSOR, ACCELERATION, *ADVISED, *DRIVEN, *ON_MISSION, *AUDITS)
MACED = (MKEY, AUTH_S, AUTH_S_PAPER, AUTH_A_PAPER, TREQ, TREQ_PAPER, TOKEN, SEALED)
HANDED_OUT = (AUTHENTICATOR, TOKEN_REQUEST, BOARD, SEAL)
SHOWN = (REQUEST, COVERING_TOKEN, BOOTED, CHECKPOINT, PROOF, KEPT, KEPT_CLAIM)
REMEMBERED = (
    OUTPUT,
    FLOCK_MEMORY,
    NEIGHBOUR,
    guarded.PROMISE,
    guarded.GUARD_MEMORY,
    *driven.REMEMBERED,
    MISSION_MEMORY,
    CRUMB,
)
OF_NODES = (ENTRY, *LOGGED, *PAYLOADS, *MACED, *HANDED_OUT)
RECORDS = (*OF_NODES, *SHOWN, *REMEMBERED, ROBOT_PLACE, *missions.RECORDS, *lines.RECORDS)
