"""THE byte table of bounded-time interaction: the only place that knows a width, an order or a tag.

`firmware/generate.py` makes firmware/include/phx_wire.h and the tables of docs/spec/rebound-nodes.md from it.
Integers are little-endian. A robot id is a u16, 0 is none. `t` is a trusted node's own clock in ms since power-up.
Source: RoboRebound Alg. 2-4 (what is hashed and MACed) and §5.2 (27 and 19 byte payloads, 7 bytes over each entry).
"""

from __future__ import annotations

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

# --- frames and payloads -------------------------------------------------------------------------------------------

KIND_STATE = 0x01
KIND_SENSOR = 0x02
KIND_ACCELERATION = 0x03
KIND_ORDER = 0x04
KIND_WHEELS_COMMAND = 0x05
KIND_WHEELS_SENSOR = 0x06
KIND_WHEELS_STATE = 0x07
KIND_AUDIT = 0x80  # the bit that keeps a frame out of the chains

_MOTION = (
    Field("id", "u16", "robot id"),
    Field("t", "u64", "ms, sender's clock"),
    Field("x_m", "f32", "position, world frame"),
    Field("y_m", "f32", ""),
    Field("vx_mps", "f32", "velocity, world frame"),
    Field("vy_mps", "f32", ""),
)
STATE = Record("state", _MOTION, "broadcast: where a robot is and where it goes", KIND_STATE)
SENSOR = Record("sensor", _MOTION, "reading of the position sensor", KIND_SENSOR)
ACCELERATION = Record(
    "acceleration",
    (
        Field("id", "u16", "robot id"),
        Field("t", "u64", "ms, sender's clock"),
        Field("ax_mps2", "f32", "acceleration, world frame"),
        Field("ay_mps2", "f32", ""),
    ),
    "command to the actuators",
    KIND_ACCELERATION,
)

# Robots that visitors drive (docs/spec/vocabulary.md): x to the right, y down.
ORDER = Record(
    "order",
    (
        Field("id", "u16", "of the robot that is told"),
        Field("number", "u32", "above that of the last order to it"),
        Field("action", "u8", "1 wheels, 2 LED, 3 route"),
        Field("body", "rest", "as the action has it (robot/controllers/orders.py)"),
    ),
    "what a gateway tells a robot",
    KIND_ORDER,
)
_POSE = (
    Field("id", "u16", "robot id"),
    Field("t", "u64", "ms, sender's clock"),
    Field("x_mm", "f32", "position"),
    Field("y_mm", "f32", ""),
    Field("direction_deg", "f32", "the nose points along (-sin, cos)"),
)
_LED = (Field("red", "u8", ""), Field("green", "u8", ""), Field("blue", "u8", ""))
WHEELS_COMMAND = Record(
    "wheels_command",
    (
        Field("id", "u16", "robot id"),
        Field("t", "u64", "ms, sender's clock"),
        Field("left", "u8", "percent, two's complement"),
        Field("right", "u8", "the same"),
        *_LED,
    ),
    "command to wheels and LED",
    KIND_WHEELS_COMMAND,
)
WHEELS_SENSOR = Record("wheels_sensor", _POSE, "reading of the pose sensor", KIND_WHEELS_SENSOR)
WHEELS_STATE = Record(
    "wheels_state", (*_POSE, *_LED), "broadcast: where a driven robot is and how it shines", KIND_WHEELS_STATE
)

HELLO = 0
FRAGMENT = 1
TOKEN_REPLY = 2

_AUDIT = (Field("src", "u16", "robot id; in `bound` written by the a-node"), Field("dst", "u16", "robot id, 0 for all"))
AUDIT_HELLO = Record("audit_hello", (*_AUDIT, Field("sub", "u8", "", HELLO)), "here is somebody who audits", KIND_AUDIT)
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

DRIVEN = (ORDER, WHEELS_COMMAND, WHEELS_SENSOR, WHEELS_STATE)
PAYLOADS = (STATE, SENSOR, ACCELERATION, *DRIVEN, AUDIT_HELLO, AUDIT_FRAGMENT, AUDIT_TOKEN)
MACED = (MKEY, AUTH_S, AUTH_S_PAPER, AUTH_A_PAPER, TREQ, TREQ_PAPER, TOKEN)
RECORDS = (ENTRY, *PAYLOADS, *MACED)
