"""The byte table's page of the serial line: what a c-node asks its robot's two trusted nodes, and what they answer.

A call's tag says which function it is of; its fields are the function's arguments. `firmware/generate.py` makes
firmware/include/phx_line_wire.h and the tables of docs/spec/serial.md from it.
"""

from __future__ import annotations

from .record import Record, record

VERSION = 1
MARK = 0x00  # before and after each frame, and nowhere inside
CRC_BYTES = 4  # CRC-32 (ISO-HDLC), little-endian, behind the payload
RUN_MAX = 254  # bytes of one block without a zero

# What a board leaves to the c-node: bits of `told` in `about`.
TOLD_CLOCK = 1  # a bench's: tests tell it the time
TOLD_READINGS = 2  # the sensors hang on the c-node, which reports them
SEALED = 4  # a bit of `told` as well: a seal goes out behind each packet, and none is taken without one

# What is answered instead of a node's own code.
E_CALL = -64  # no such call, or not of its length
E_HELLO = -65  # no handshake since power-up, or of another version

_NUMBER = "number u16: of the call; said again, it is answered again, and not done again"
_TOP = "top b20: of the chain"
_HCKPT = "hckpt b20: hash of the checkpoint"
_MAC = "mac b8"
_AUDITOR = "auditor u16: auditor"
_AUDITEE = "auditee u16: auditee"
_T = "t u32: ms, of the token request"


_calls: list[Record] = []


def _call(tag: int, head: str, *declared: str) -> Record:
    _calls.append(record(f"call_{head}", _NUMBER, *declared, tag=tag))
    return _calls[-1]


HELLO = _call(0x40, "hello: handshake; answered with `about`", "version u8: of whoever asks")
LIMITS = _call(
    0x41,
    "limits: manufacture: both nodes begin anew; until a master key is loaded",
    "f_max t_val_ms batch_size bucket_capacity bucket_period_ms send_us_per_s send_capacity_us audit_us_per_s "
    "audit_capacity_us airtime_fixed_us airtime_ns_per_byte_broadcast airtime_ns_per_byte_unicast u32",
)
LOAD_MASTER = _call(0x42, "load_master: both nodes", "key b20: master key", "id u16: robot id")
LOAD_MISSION = _call(
    0x43,
    "load_mission: both nodes",
    "k b20: mission key XOR H(r ‖ master key)",
    "r b20: random",
    "seq u32: rises",
    _MAC,
)
CLOCK = _call(0x44, "clock: it is so late; for a bench only", "t u32: ms, never before the last")
POLL = _call(0x45, "poll: s-node; an `entry`", "reading rest: empty where the board has the sensors")
RECV = _call(0x46, "recv: a-node; an `entry`", "packet rest: from the radio")
SEND = _call(0x47, "send: a-node; an `entry`", "packet rest: to the radio")
ACTUATE = _call(0x48, "actuate: a-node; an `entry`", "command rest: to the actuators")
MAKE_AUTH = _call(0x49, "make_auth: s-node; an `authenticator`", "nonce b8: MAC of the token request")
CHECK_AUTH = _call(0x4A, "check_auth: s-node", _TOP, "id u16: robot id", "nonce b8", _MAC)
TOKEN_REQUEST = _call(0x4B, "token_request: a-node; a `token_request`", _AUDITOR)
ISSUE_TOKEN = _call(
    0x4C, "issue_token: a-node; the token's MAC", _AUDITEE, _T, _TOP, "treq_mac b8: of the request", _HCKPT
)
CHECK_TOKEN = _call(0x4D, "check_token: a-node", _AUDITOR, _AUDITEE, _T, _HCKPT, _MAC)
INSTALL_TOKEN = _call(0x4E, "install_token: a-node", _AUDITOR, _T, _HCKPT, _MAC)
CHECK = _call(0x4F, "check: a-node; code 1 in Safe Mode")
SEAL = _call(0x50, "seal: manufacture: the radio is sealed, for ever; until a master key is loaded")

ANSWER = record(
    "answer: to each call",
    "number u16: of the call",
    "code i32: what the function returned, or an error",
    "result rest: what it made, if the code is no error",
    tag=0x60,
)
ABOUT = record(
    "about: what a board says of itself",
    "version u8: of the board; all else is as that version has it",
    "told u8: 1: the clock, 2: readings; 4: the radio is sealed",
    "id u16: robot id, 0 before a master key is loaded",
    "seq u32: of the last mission key",
)

CALLS = tuple(_calls)
RECORDS = (*CALLS, ANSWER, ABOUT)
