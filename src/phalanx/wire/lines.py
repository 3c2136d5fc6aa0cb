"""Records of the serial line: calls of a c-node to its robot's two trusted nodes, and answers. Part of the byte table.

The tag of a call selects a function; the fields are its arguments. `firmware/generate.py` writes
firmware/include/phx_line_wire.h and the tables of docs/spec/serial.md from this file.
"""

from __future__ import annotations

from .record import Record, record

VERSION = 1
MARK = 0x00  # before and after each frame, and nowhere inside
CRC_BYTES = 4  # CRC-32 (ISO-HDLC), little-endian, after the payload
RUN_MAX = 254  # bytes of one block without a zero

# Bits of `told` in `about`: inputs that the board gets from the c-node, and the sealed radio.
TOLD_CLOCK = 1  # test board without a clock: the c-node sends it the time
TOLD_READINGS = 2  # sensors are connected to the c-node, which sends the readings
SEALED = 4  # sealed radio: a seal follows each packet sent, and packets without one are dropped

# Error codes of the line itself, beside those of the nodes' functions.
E_CALL = -64  # no such call, or a wrong length
E_HELLO = -65  # no handshake since power-up, or another version

_NUMBER = "number u16: number of the call; a repeated call gets the same answer, and is not executed again"
_TOP = "top b20: top of the chain"
_HCKPT = "hckpt b20: hash of the checkpoint"
_MAC = "mac b8"
_AUDITOR = "auditor u16: auditor"
_AUDITEE = "auditee u16: auditee"
_T = "t u32: ms, time of the token request"


_calls: list[Record] = []


def _call(tag: int, head: str, *declared: str) -> Record:
    _calls.append(record(f"call_{head}", _NUMBER, *declared, tag=tag))
    return _calls[-1]


HELLO = _call(0x40, "hello: handshake; answered with `about`", "version u8: protocol version of the caller")
LIMITS = _call(
    0x41,
    "limits: manufacture: set the limits of both nodes and reset them; only before a master key is loaded",
    "f_max t_val_ms batch_size bucket_capacity bucket_period_ms send_us_per_s send_capacity_us audit_us_per_s "
    "audit_capacity_us airtime_fixed_us airtime_ns_per_byte_broadcast airtime_ns_per_byte_unicast u32",
)
LOAD_MASTER = _call(0x42, "load_master: to both nodes", "key b20: master key", "id u16: robot id")
LOAD_MISSION = _call(
    0x43,
    "load_mission: to both nodes",
    "k b20: mission key XOR H(r ‖ master key)",
    "r b20: random",
    "seq u32: rises",
    _MAC,
)
CLOCK = _call(0x44, "clock: set the time of a test board", "t u32: ms, never earlier than before")
POLL = _call(0x45, "poll: s-node; result an `entry`", "reading rest: empty if the sensors are connected to the board")
RECV = _call(0x46, "recv: a-node; result an `entry`", "packet rest: from the radio")
SEND = _call(0x47, "send: a-node; result an `entry`", "packet rest: to the radio")
ACTUATE = _call(0x48, "actuate: a-node; result an `entry`", "command rest: to the actuators")
MAKE_AUTH = _call(0x49, "make_auth: s-node; result an `authenticator`", "nonce b8: MAC of the token request")
CHECK_AUTH = _call(0x4A, "check_auth: s-node", _TOP, "id u16: robot id", "nonce b8", _MAC)
TOKEN_REQUEST = _call(0x4B, "token_request: a-node; result a `token_request`", _AUDITOR)
ISSUE_TOKEN = _call(
    0x4C, "issue_token: a-node; result the token's MAC", _AUDITEE, _T, _TOP, "treq_mac b8: MAC of the request", _HCKPT
)
CHECK_TOKEN = _call(0x4D, "check_token: a-node", _AUDITOR, _AUDITEE, _T, _HCKPT, _MAC)
INSTALL_TOKEN = _call(0x4E, "install_token: a-node", _AUDITOR, _T, _HCKPT, _MAC)
CHECK = _call(0x4F, "check: a-node; returns code 1 in Safe Mode")
SEAL = _call(0x50, "seal: manufacture: seal the radio permanently; only before a master key is loaded")

ANSWER = record(
    "answer: answer to a call",
    "number u16: number of the call",
    "code i32: return value of the function, or an error",
    "result rest: result of the function, if the code is no error",
    tag=0x60,
)
ABOUT = record(
    "about: description of a board",
    "version u8: protocol version of the board; it defines the fields that follow",
    "told u8: bits: the c-node sends 1 the time, 2 readings; 4 the radio is sealed",
    "id u16: robot id, 0 before a master key is loaded",
    "seq u32: sequence number of the last mission key",
)

CALLS = tuple(_calls)
RECORDS = (*CALLS, ANSWER, ABOUT)
