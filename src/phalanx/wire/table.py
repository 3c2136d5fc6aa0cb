"""The byte table: the only definition of widths, field orders and tags, together with the modules that it imports.

`firmware/generate.py` writes firmware/include/phx_wire.h and the tables of docs/spec/rebound*.md from this file.
Kernels use its offsets as module constants (`AT_MAC = AUDIT_TOKEN.at("mac")`), which compile to literals.
Integers are little-endian. A robot id is a u16, 0 is none. `t` is a trusted node's own clock in ms since power-up.
Source: RoboRebound Alg. 2-4 (hashed and MACed bytes) and §5.2 (27 and 19 byte payloads, 7 bytes of header per entry).
"""

from __future__ import annotations

from . import driven, guarded, lines, missions, sessions
from .record import fields, record

HASH_BYTES = 20  # SHA-1
MAC_BYTES = 8  # LightMAC over PRESENT-80
KEY_BYTES = 20  # K1 ‖ K2, as long as a hash, because the mission key is blinded with a hash
NONCE_BYTES = 8  # MAC of the token request that an authenticator answers
PACKET_MAX = 2048  # longest packet, sensor reading or actuator command, bytes

# --- entries of the two chains -----------------------------------------------------------------------------------

ENTRY_INPUT = 1  # s-chain: a sensor reading
ENTRY_RECV = 2  # a-chain: a packet from the radio
ENTRY_SEND = 3  # a-chain: a packet to the radio
ENTRY_ACMD = 4  # a-chain: a command to the actuators

ENTRY = record(
    "entry: an event in a hash chain and in the c-node's log",
    "type u8: 1 INPUT, 2 RECV, 3 SEND, 4 ACMD",
    "t u32: ms, clock of the node that chained it",
    "payload v16: u16 length, then the reading, the whole packet or the command",
)
ENTRY_HEADER_BYTES = ENTRY.size

# --- further records of a c-node's log, in no chain ----------------------------------------------------------------

MARK = 0x80  # bit of the first byte that entries do not have
MARK_FLUSH_S = 0x81
MARK_FLUSH_A = 0x82
MARK_CHECKPOINT = 0x83
MARK_EVIDENCE = 0x84

FLUSHED_S = record("flushed_s: the s-chain was flushed here before its batch was full", tag=MARK_FLUSH_S)
FLUSHED_A = record("flushed_a: the a-chain was flushed here before its batch was full", tag=MARK_FLUSH_A)
CHECKED = record("checked: the checkpoint was taken here", tag=MARK_CHECKPOINT)
EVIDENCE = record(
    "evidence: evidence for the INPUT immediately before it",
    "bytes v16: u16 length, then the evidence that the controller keeps of a reading",
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
KIND_AUDIT = 0x80  # bit of packets that are not chained

_SAID = fields("id u16: robot id", "t u64: ms, sender's clock")
_MOTION = fields("x_m y_m f32: position, world frame", "vx_mps vy_mps f32: velocity, world frame")
STATE = record("state: broadcast: position and velocity of a robot", *_SAID, *_MOTION, tag=KIND_STATE)
SENSOR = record("sensor: reading of the position sensor", *_SAID, *_MOTION, tag=KIND_SENSOR)
ACCELERATION = record(
    "acceleration: command to the actuators",
    *_SAID,
    "ax_mps2 ay_mps2 f32: acceleration, world frame",
    tag=KIND_ACCELERATION,
)

# Robots that visitors drive (docs/spec/vocabulary.md): x points right, y down.
WHEELS_COMMAND = record(
    "wheels_command: command to wheels and LED", *_SAID, *driven.WHEELS, *driven.LED, tag=KIND_WHEELS_COMMAND
)
WHEELS_SENSOR = record("wheels_sensor: reading of the pose sensor", *_SAID, *driven.POSE, tag=KIND_WHEELS_SENSOR)
WHEELS_STATE = record(
    "wheels_state: broadcast: pose and LED colour of a driven robot",
    *_SAID,
    *driven.POSE,
    *driven.LED,
    tag=KIND_WHEELS_STATE,
)

# Robots on encoded missions (docs/spec/mission.md).
(RANGE,) = fields("range u16: mm; 0: no measurement, 0xFFFF: a miss")
MISSION_READING = record(
    "mission_reading: reading of a mission robot's odometry and lidar",
    *_SAID,
    "x y i32: 0.1 mm, odometry frame, never corrected",
    "heading i32: µrad, the same frame",
    "travelled_mm u32: distance since the start, forwards and backwards",
    "scan_sha1 b20: SHA-1 of the scan (a range for each beam) and the other sensors' readings",
    "clear rest: a byte for each sector: distance of the nearest hit, in steps of 2 cm, 255 from 5.1 m on",
    tag=KIND_MISSION_READING,
)
MISSION_MESSAGE = record(
    "mission_message: broadcast, repeated: a message that a decoded node sends",
    "id u16: robot id",
    "message b32: encoded message of the mission",
    tag=KIND_MISSION_MESSAGE,
)
DRIVE = record("drive: command to a mission robot's wheels", *_SAID, "speed_mmps turn_mradps i16", tag=KIND_DRIVE)
ACTION = record(
    "action: command: the action of a decoded node",
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
AUDIT_HELLO = record("audit_hello: announcement of an auditor", *_AUDIT, f"sub u8 = {HELLO}", tag=KIND_AUDIT)
AUDIT_SEEK = record(
    "audit_seek: search for auditors by a robot without enough tokens; receivers answer, each at a random time",
    *_AUDIT,
    f"sub u8 = {SEEK}",
    "nonce u32: random; an answer repeats it",
    "since u32: ms, auditee's a-node clock: auditors repeat their tokens for requests from this time on",
    "share u8: number of robots among 256 that answer, less one",
    tag=KIND_AUDIT,
)
AUDIT_HERE = record(
    "audit_here: answer to a SEEK by a robot with no token to repeat",
    *_AUDIT,
    f"sub u8 = {HERE}",
    "nonce u32: nonce of the SEEK",
    tag=KIND_AUDIT,
)
AUDIT_FRAGMENT = record(
    "audit_fragment: fragment of a request for an audit",
    *_AUDIT,
    f"sub u8 = {FRAGMENT}",
    "request u16: number of the request, counted by the auditee",
    "index u8: index of this fragment, from 0",
    "count u8: number of fragments",
    "bytes rest: bytes of the request",
    tag=KIND_AUDIT,
)
AUDIT_TOKEN = record(
    "audit_token: the auditor's answer",
    *_AUDIT,
    f"sub u8 = {TOKEN_REPLY}",
    "request u16: number of the request",
    "t u32: ms, auditee's a-node clock at the request",
    "mac b8: MAC of the token",
    tag=KIND_AUDIT,
)
AUDIT_HEADER_BYTES = AUDIT_HELLO.size

# --- MACed messages ------------------------------------------------------------------------------------------------

MKEY = record(
    "mkey: mission key, blinded with the master key",
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
    "token: an auditor's proof that it replayed the log and found no fault",
    "auditor u16: auditor",
    "auditee u16: auditee",
    "t u32: ms, time of the request",
    "hckpt b20: hash of the audited checkpoint",
    tag=0x14,
)
_SENDER = fields("t u32: ms, sender's a-node clock; unique for each packet", "src u16: robot id")
SEALED = record("sealed: a packet on a sealed radio", *_SENDER, "hash b20: hash of the packet", tag=0x15)

# --- inputs and results of trusted nodes ---------------------------------------------------------------------------

BOARD = record("board: data written to trusted nodes at manufacture", "id u16: robot id", "master b20: master key")
AUTHENTICATOR = record(
    "authenticator: result of `make_auth`", "top b20: top of the chain, just flushed", "id u16: robot id", "mac b8"
)
TOKEN_REQUEST = record(
    "token_request: result of the call `token_request`",
    "t u32: ms, auditee's a-node clock",
    "top b20: top of the a-chain, just flushed; zeros in profile `paper`",
    "mac b8",
)
SEAL = record("seal: follows each packet on a sealed radio", *_SENDER, "mac b8: MAC of `sealed`")

# --- an auditee's request and evidence -----------------------------------------------------------------------------

REQUEST_VERSION = 0x01

REQUEST = record(
    "request: request for an audit; the tag is its version",
    "flags u8: 1: the log begins at boot",
    "auditee u16: auditee",
    "t u32: ms, time of the token request",
    "top_a b20: top of the a-chain",
    "treq_mac b8: MAC of the token request",
    "top_s b20: top of the s-chain",
    "auth_s_mac b8: MAC of the s-node's authenticator",
    "auth_a_mac b8: MAC of the a-node's authenticator, in `paper` only",
    "hckpt b20: hash of the claimed checkpoint",
    "tokens u8: number of tokens that cover the start",
    "start_length u16: bytes of the start",
    "segment_length u32: bytes of the log segment",
    "shown rest: covering tokens, start, segment of the log",
    tag=REQUEST_VERSION,
)
COVERING_TOKEN = record(
    "covering_token: token for the start", "auditor u16: auditor", "t u32: ms, time of its request", "mac b8"
)
BOOTED = record("booted: start of a log that begins at boot", "t_key u32: ms, when the mission key was loaded")
CHECKPOINT = record(
    "checkpoint: any other start; tokens cover its hash",
    "t u32: ms, when the next INPUT is due",
    "step u32: number of that INPUT",
    "top_s b20: top of the s-chain",
    "top_a b20: top of the a-chain",
    "state rest: the controller's memory",
)

KEPT = record(
    "kept: evidence that a mission robot keeps of a reading",
    "claims u8: number of claims, 0 or 1",
    "shown rest: the claim as `kept_claim`, then the scan's differences; or nothing",
)
PROOF = record(
    "proof: in a robot's stored log: authenticators of its trusted nodes for all entries before",
    "auditor u16: auditor to whom the request was sent",
    f"head b{REQUEST.size}: first bytes of the request",
    tag=0x86,
)
KEPT_CLAIM = record("kept_claim: claim that the scan supports", "claim v16: u16 length, then the claim")

# --- outputs and memory of controllers -----------------------------------------------------------------------------

OUTPUT = record(
    "output: output of a controller",
    "type u8: 3 SEND, 4 ACMD",
    "payload v16: u16 length, then the packet or the command",
)
FLOCK_MEMORY = record(
    "flock_memory: memory of a flocking controller",
    *_MOTION,
    "count u16: number of neighbours",
    "neighbours rest: `count` records, by rising id",
)
NEIGHBOUR = record(
    "neighbour: last received state of a robot", "id u16: robot id", "heard u64: ms, own a-node's clock", *_MOTION
)
MISSION_MEMORY = record(
    "mission_memory: memory of a mission robot's controller",
    "begun u64: ms, s-node's clock at the first reading; 0 before",
    "x_m y_m heading_rad f64: estimated pose, map frame",
    "way f64: estimated scale error of odometry, distance",
    "turn f64: estimated scale error of odometry, turns",
    "curve f64: estimated curvature error of odometry, rad/m",
    " ".join(f"spread_{i}{j}" for i in range(6) for j in range(i, 6)) + " f64: their covariance",
    "odometry_x_m odometry_y_m odometry_rad f64: odometry pose of the last reading, odometry frame",
    "kind i8: kind of the current instruction, -1: none",
    "target i64: node, or -1",
    "begin i64: node, or -1",
    "passed u8: 1: the robot has passed the place where the instruction begins",
    "best_m f64: smallest remaining distance so far",
    "best_s f64: time of that smallest distance",
    "turning i8: 1, -1: turning about to the left, right; 2, -2: has turned; 0: not yet",
    "stop_x_cm stop_y_cm i32: next point of a detour, odometry frame; both -2^31: none",
    "base_x base_y i32: index of the first cell of the local grid, odometry frame",
    "seen_s f64: time of the last update of the grid",
    "waited_s f64: time waited before a long detour",
    "cells b576: 2 bits for each of 48 x 48 cells of 0.125 m: 3: just hit; one less every 4 s; 0: free",
    "blocked u8: 1: the robot gave up the way at the last step",
    "said u8: number of messages that it broadcasts",
    "crumbs u8: number of remembered points of the way here",
    "rest rest: messages, 32 bytes each; crumbs; then the walk (docs/spec/mission.md)",
)
CRUMB = record("crumb: point of the way back", "x_cm y_cm i32: map frame")

# --- state updates of pages ----------------------------------------------------------------------------------------

TURN_DEG = 360
PASS_BY = 181  # robot numbers skipped by a record that is no robot
ROBOT_PLACE = record(
    "robot_place: position of a robot in a state update; with a w of 181 · 360 or more it is no robot, and skips 181 "
    "numbers",
    "w u16: TURN_DEG · (robot numbers skipped before this one) + direction, whole degrees",
    "x u16: steps from the left edge of the piece",
    "y u16: steps from its top edge",
)
ROUTE_POINT = record(
    "route_point: point of a route in a state update",
    "x u16: steps from the left edge of the route",
    "y u16: steps from its top edge",
)

# --- groups of records in which the first byte is unique -----------------------------------------------------------

LOGGED = (FLUSHED_S, FLUSHED_A, CHECKED, EVIDENCE, guarded.ADVICE)  # beside ENTRY, whose first byte is its type
DRIVEN = (*driven.ORDERS, WHEELS_COMMAND, WHEELS_SENSOR, WHEELS_STATE)
ON_MISSION = (MISSION_READING, MISSION_MESSAGE, DRIVE, ACTION)
ADVISED = (guarded.WISH, guarded.SIGNED_WISH)
AUDITS = (AUDIT_HELLO, AUDIT_SEEK, AUDIT_HERE, AUDIT_FRAGMENT, AUDIT_TOKEN)
PAYLOADS = (STATE, SENSOR, ACCELERATION, *ADVISED, *DRIVEN, *ON_MISSION, *AUDITS)
MACED = (MKEY, AUTH_S, AUTH_S_PAPER, AUTH_A_PAPER, TREQ, TREQ_PAPER, TOKEN, SEALED)
HANDED_OUT = (AUTHENTICATOR, TOKEN_REQUEST, BOARD, SEAL)
IN_STATE_UPDATES = (ROBOT_PLACE, ROUTE_POINT)
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
