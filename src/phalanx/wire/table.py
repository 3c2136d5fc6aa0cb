"""THE byte table: the only place that knows a width, an order or a tag; the modules beside it are its pages.

`firmware/generate.py` makes firmware/include/phx_wire.h and the tables of docs/spec/rebound*.md from it. Kernels take
offsets from it as constants of their modules (`AT_MAC = AUDIT_TOKEN.at("mac")`), which compile to literals.
Integers are little-endian. A robot id is a u16, 0 is none. `t` is a trusted node's own clock in ms since power-up.
Source: RoboRebound Alg. 2-4 (what is hashed and MACed) and §5.2 (27 and 19 byte payloads, 7 bytes over each entry).
"""

from __future__ import annotations

from . import driven, guarded, lines, missions, sessions
from .record import fields, record

HASH_BYTES = 20  # SHA-1
MAC_BYTES = 8  # LightMAC over PRESENT-80
KEY_BYTES = 20  # K1 ‖ K2, as long as a hash: the mission key is blinded with one
NONCE_BYTES = 8  # the MAC of the token request that an authenticator answers
PACKET_MAX = 2048  # of a packet, a sensor reading or an actuator command, bytes

# --- entries of the two chains -----------------------------------------------------------------------------------

ENTRY_INPUT = 1  # s-chain: what a sensor said
ENTRY_RECV = 2  # a-chain: a packet from the radio
ENTRY_SEND = 3  # a-chain: a packet to the radio
ENTRY_ACMD = 4  # a-chain: a command to the actuators

ENTRY = record(
    "entry: what is chained and what the c-node logs",
    "type u8: 1 INPUT, 2 RECV, 3 SEND, 4 ACMD",
    "t u32: ms, clock of the node that chained it",
    "payload v16: u16 length, then the reading, the whole packet or the command",
)
ENTRY_HEADER_BYTES = ENTRY.size

# --- beside entries in a c-node's log, in no chain -----------------------------------------------------------------

MARK = 0x80  # the bit that tells them from entries
MARK_FLUSH_S = 0x81
MARK_FLUSH_A = 0x82
MARK_CHECKPOINT = 0x83
MARK_EVIDENCE = 0x84

FLUSHED_S = record("flushed_s: the s-chain was flushed here before its batch was full", tag=MARK_FLUSH_S)
FLUSHED_A = record("flushed_a: the a-chain was", tag=MARK_FLUSH_A)
CHECKED = record("checked: the checkpoint was taken here", tag=MARK_CHECKPOINT)
EVIDENCE = record(
    "evidence: of the INPUT right before it",
    "bytes v16: u16 length, then what the controller keeps of a reading",
    tag=MARK_EVIDENCE,
)

# --- packets and payloads -------------------------------------------------------------------------------------------

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
KIND_AUDIT = 0x80  # the bit that keeps a packet out of the chains

_SAID = fields("id u16: robot id", "t u64: ms, sender's clock")
_MOTION = fields("x_m y_m f32: position, world frame", "vx_mps vy_mps f32: velocity, world frame")
STATE = record("state: broadcast: where a robot is and where it goes", *_SAID, *_MOTION, tag=KIND_STATE)
SENSOR = record("sensor: reading of the position sensor", *_SAID, *_MOTION, tag=KIND_SENSOR)
ACCELERATION = record(
    "acceleration: command to the actuators",
    *_SAID,
    "ax_mps2 ay_mps2 f32: acceleration, world frame",
    tag=KIND_ACCELERATION,
)

# Robots that visitors drive (docs/spec/vocabulary.md): x to the right, y down.
WHEELS_COMMAND = record(
    "wheels_command: command to wheels and LED", *_SAID, *driven.WHEELS, *driven.LED, tag=KIND_WHEELS_COMMAND
)
WHEELS_SENSOR = record("wheels_sensor: reading of the pose sensor", *_SAID, *driven.POSE, tag=KIND_WHEELS_SENSOR)
WHEELS_STATE = record(
    "wheels_state: broadcast: where a driven robot is and how it shines",
    *_SAID,
    *driven.POSE,
    *driven.LED,
    tag=KIND_WHEELS_STATE,
)

# Robots on encoded missions (docs/spec/mission.md).
(RANGE,) = fields("range u16: mm; 0 says nothing, 0xFFFF a miss")
MISSION_READING = record(
    "mission_reading: reading of a mission robot's odometry and lidar",
    *_SAID,
    "x y i32: 0.1 mm, odometry's own frame, never corrected",
    "heading i32: µrad, the same frame",
    "travelled_mm u32: since the start, forwards and backwards",
    "scan_sha1 b20: of the scan, a range for each beam, and what other sensors read",
    "clear rest: a byte for each sector: the nearest hit, in steps of 2 cm, 255 from 5.1 m on",
    tag=KIND_MISSION_READING,
)
MISSION_MESSAGE = record(
    "mission_message: broadcast, again and again: what a decoded node gives out",
    "id u16: robot id",
    "message b32: encoded message of the mission",
    tag=KIND_MISSION_MESSAGE,
)
DRIVE = record("drive: command to a mission robot's wheels", *_SAID, "speed_mmps turn_mradps i16", tag=KIND_DRIVE)
ACTION = record(
    "action: command: what a decoded node has the robot do",
    *_SAID,
    "action rest: the action's canonical bytes",
    tag=KIND_ACTION,
)

HELLO = 0
FRAGMENT = 1
TOKEN_REPLY = 2
SEEK = 3
HERE = 4

_AUDIT = fields("src u16: robot id; in `hardened` written by the a-node", "dst u16: robot id, 0 for all")
AUDIT_HELLO = record("audit_hello: here is somebody who audits", *_AUDIT, f"sub u8 = {HELLO}", tag=KIND_AUDIT)
AUDIT_SEEK = record(
    "audit_seek: lacks tokens; robots that receive it answer, each at a random time",
    *_AUDIT,
    f"sub u8 = {SEEK}",
    "nonce u32: random; an answer repeats it",
    "since u32: ms, auditee's a-node clock: tokens for requests from then on are wanted again",
    "share u8: how many of 256 robots shall answer, less one",
    tag=KIND_AUDIT,
)
AUDIT_HERE = record(
    "audit_here: answer to a SEEK where no token is to be repeated",
    *_AUDIT,
    f"sub u8 = {HERE}",
    "nonce u32: of the SEEK",
    tag=KIND_AUDIT,
)
AUDIT_FRAGMENT = record(
    "audit_fragment: a piece of a request for an audit",
    *_AUDIT,
    f"sub u8 = {FRAGMENT}",
    "request u16: number of the request, auditee's",
    "index u8: of this fragment, from 0",
    "count u8: of fragments",
    "bytes rest: piece of the request",
    tag=KIND_AUDIT,
)
AUDIT_TOKEN = record(
    "audit_token: the auditor's answer",
    *_AUDIT,
    f"sub u8 = {TOKEN_REPLY}",
    "request u16: the number that the request had",
    "t u32: ms, auditee's a-node clock at the request",
    "mac b8: of the token",
    tag=KIND_AUDIT,
)
AUDIT_HEADER_BYTES = AUDIT_HELLO.size

# --- what is MACed -------------------------------------------------------------------------------------------------

MKEY = record(
    "mkey: mission key, under the master key",
    "k b20: mission key XOR H(r ‖ master key)",
    "r b20: random",
    "seq u32: rises",
    tag=0x10,
)
_AUTH = fields("thash b20: top of the chain", "id u16: robot id")
AUTH_S = record("auth_s: authenticator of an s-node", *_AUTH, "nonce b8: MAC of the token request", tag=0x11)
AUTH_S_PAPER = record("auth_s_paper: the same in profile `paper`", *_AUTH, tag=0x11)
AUTH_A_PAPER = record("auth_a_paper: authenticator of an a-node; in profile `paper` only", *_AUTH, tag=0x12)
_TREQ = fields("t u32: ms, auditee's a-node clock", "auditee u16: auditee", "auditor u16: auditor")
TREQ = record("treq: token request", *_TREQ, "thash_a b20: top of the a-chain, just flushed", tag=0x13)
TREQ_PAPER = record("treq_paper: the same in profile `paper`", *_TREQ, tag=0x13)
TOKEN = record(
    "token: an auditor's word that it replayed the log and found no fault",
    "auditor u16: auditor",
    "auditee u16: auditee",
    "t u32: ms, of the request",
    "hckpt b20: hash of the checkpoint that was audited",
    tag=0x14,
)
_SENDER = fields("t u32: ms, sender's a-node clock; no two packets have the same", "src u16: robot id")
SEALED = record("sealed: a packet on a sealed radio", *_SENDER, "hash b20: of the packet", tag=0x15)

# --- what trusted nodes hand out -----------------------------------------------------------------------------------

BOARD = record("board: what trusted nodes are given when they are made", "id u16: robot id", "master b20: master key")
AUTHENTICATOR = record(
    "authenticator: from make authenticator", "top b20: of the chain, just flushed", "id u16: robot id", "mac b8"
)
TOKEN_REQUEST = record(
    "token_request: from make token request",
    "t u32: ms, auditee's a-node clock",
    "top b20: of the a-chain, just flushed; zeros in profile `paper`",
    "mac b8",
)
SEAL = record("seal: behind each packet on a sealed radio", *_SENDER, "mac b8: of `sealed`")

# --- what an auditee shows -----------------------------------------------------------------------------------------

REQUEST_VERSION = 0x01

REQUEST = record(
    "request: request for an audit; the tag is its version",
    "flags u8: 1: the log begins at boot",
    "auditee u16: auditee",
    "t u32: ms, of the token request",
    "top_a b20: top of the a-chain",
    "treq_mac b8: of the token request",
    "top_s b20: top of the s-chain",
    "auth_s_mac b8: of its authenticator",
    "auth_a_mac b8: of the a-node's, in `paper` only",
    "hckpt b20: hash of the checkpoint claimed",
    "tokens u8: that cover the start",
    "start_length u16: of the start",
    "segment_length u32: of the log",
    "shown rest: covering tokens, start, segment of the log",
    tag=REQUEST_VERSION,
)
COVERING_TOKEN = record(
    "covering_token: an auditor's word for the start", "auditor u16: auditor", "t u32: ms, of its request", "mac b8"
)
BOOTED = record("booted: the start of a log that begins at boot", "t_key u32: ms, when the mission key was loaded")
CHECKPOINT = record(
    "checkpoint: any other start; what tokens cover the hash of",
    "t u32: ms, when the next INPUT is due",
    "step u32: its number",
    "top_s b20: top of the s-chain",
    "top_a b20: top of the a-chain",
    "state rest: the controller's memory",
)

KEPT = record(
    "kept: evidence of a mission robot's",
    "claims u8: 0 or 1",
    "shown rest: it, then the scan's differences, or nothing",
)
PROOF = record(
    "proof: in a robot's kept log: what its trusted nodes said of all that stands before",
    "auditor u16: whom a request asked",
    f"head b{REQUEST.size}: what it begins with",
    tag=0x86,
)
KEPT_CLAIM = record("kept_claim: what the scan is to show", "claim v16: u16 length, then the claim")

# --- what is between controllers and their c-node, and what they remember ------------------------------------------

OUTPUT = record(
    "output: what a controller puts out",
    "type u8: 3 SEND, 4 ACMD",
    "payload v16: u16 length, then the packet or the command",
)
FLOCK_MEMORY = record(
    "flock_memory: what a flock's controller remembers",
    *_MOTION,
    "count u16: of neighbours",
    "neighbours rest: as many, by rising id",
)
NEIGHBOUR = record(
    "neighbour: a robot that was heard", "id u16: robot id", "heard u64: ms, own a-node's clock", *_MOTION
)
MISSION_MEMORY = record(
    "mission_memory: what a mission robot's controller remembers",
    "begun u64: ms, s-node's clock at the first reading; 0 before",
    "x_m y_m heading_rad f64: where it believes to be, map frame",
    "way f64: what its odometry leaves out, of the way",
    "turn f64: of turns",
    "curve f64: rad a metre",
    " ".join(f"spread_{i}{j}" for i in range(6) for j in range(i, 6)) + " f64: their covariance",
    "odometry_x_m odometry_y_m odometry_rad f64: by the last reading, its own frame",
    "kind i8: of the instruction in hand, -1 for none",
    "target i64: node, or -1",
    "begin i64: node, or -1",
    "passed u8: 1: the place where it begins lies behind",
    "best_m f64: least way that was left",
    "best_s f64: when that was",
    "turning i8: 1, -1: it turns about, to the left or to the right; 2, -2: it has; 0: never yet",
    "stop_x_cm stop_y_cm i32: next place on a way around, odometry's frame; both -2^31: none",
    "base_x base_y i32: number of the first cell around, odometry's frame",
    "seen_s f64: when it last looked",
    "waited_s f64: before a long way around",
    "cells b576: 2 bits for each of 48 x 48 cells of 0.125 m: 3, hit; less every 4 s; 0: nothing",
    "blocked u8: 1: the way was given up at the last step",
    "said u8: messages that it gives out",
    "crumbs u8: places of the way here that it remembers",
    "rest rest: messages, 32 bytes each; crumbs; then the walk (docs/spec/mission.md)",
)
CRUMB = record("crumb: a place of the way back", "x_cm y_cm i32: map frame")

# --- what pages are told -------------------------------------------------------------------------------------------

TURN_DEG = 360
PASS_BY = 181  # so many numbers are left out by a record that is no robot
ROBOT_PLACE = record(
    "robot_place: where a robot is, in a state update; with a w of 181 · 360 or more it is no robot, and leaves out "
    "181 numbers",
    "w u16: TURN_DEG · (how many numbers are left out before this one) + direction, whole degrees",
    "x u16: in the piece's steps from its left",
    "y u16: from its top",
)
ROUTE_POINT = record(
    "route_point: a point of a route, in a state update",
    "x u16: in the route's steps from its left",
    "y u16: from its top",
)

# --- spaces in which a first byte is one record's ------------------------------------------------------------------

LOGGED = (FLUSHED_S, FLUSHED_A, CHECKED, EVIDENCE, guarded.ADVICE)  # beside ENTRY, whose first byte is its type
DRIVEN = (*driven.ORDERS, WHEELS_COMMAND, WHEELS_SENSOR, WHEELS_STATE)
ON_MISSION = (MISSION_READING, MISSION_MESSAGE, DRIVE, ACTION)
ADVISED = (guarded.WISH, guarded.SIGNED_WISH)
AUDITS = (AUDIT_HELLO, AUDIT_SEEK, AUDIT_HERE, AUDIT_FRAGMENT, AUDIT_TOKEN)
PAYLOADS = (STATE, SENSOR, ACCELERATION, *ADVISED, *DRIVEN, *ON_MISSION, *AUDITS)
MACED = (MKEY, AUTH_S, AUTH_S_PAPER, AUTH_A_PAPER, TREQ, TREQ_PAPER, TOKEN, SEALED)
HANDED_OUT = (AUTHENTICATOR, TOKEN_REQUEST, BOARD, SEAL)
TOLD = (ROBOT_PLACE, ROUTE_POINT)
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
RECORDS = (
    *OF_NODES,
    *SHOWN,
    *REMEMBERED,
    ROBOT_PLACE,
    ROUTE_POINT,
    *missions.RECORDS,
    *lines.RECORDS,
    *sessions.RECORDS,
)
