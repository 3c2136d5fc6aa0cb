"""What passes a robot's trusted nodes: they chain it, and the c-node logs the same bytes. Source: RoboRebound §3.4."""

from __future__ import annotations

from phalanx.bti import log, request, trusted
from phalanx.bti.audit import ACMD, INPUT, RECV, SEND
from phalanx.bti.fleet import PLAIN, Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_LENGTH, ENTRY_T
from phalanx.bti.work import Work
from phalanx.kernel import kernel
from phalanx.wire.fields import Row, copy, put_u16, put_u32


@kernel
def plain(w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Write the entry as a trusted node would make it, where there is none. Source: docs/spec/rebound.md."""
    if ENTRY_HEAD_BYTES + length > len(w.entry):
        return -1
    w.entry[0] = kind
    put_u32(w.entry, ENTRY_T, now)
    put_u16(w.entry, ENTRY_LENGTH, length)
    copy(w.entry, ENTRY_HEAD_BYTES, payload, 0, length)
    return int(ENTRY_HEAD_BYTES + length)


@kernel
def chain(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Have the trusted node chain a reading (INPUT), a packet (RECV, SEND) or a command (ACMD); write its entry.

    The entry is in `w.entry`. What is behind its head may go on: to the c-node, the radio, the actuators.
    Returns: the entry's length, or the node's error. Source: RoboRebound Alg. 3, Alg. 4.
    """
    profile = f.settings[0].profile
    if profile == PLAIN:
        return plain(w, kind, now, payload, length)
    if kind == INPUT:
        return int(trusted.snode_poll(profile, f.snode[i], now, payload, length, w.entry))
    if kind == RECV:
        return int(trusted.anode_recv(profile, f.anode[i], now, payload, length, w.entry))
    if kind == SEND:
        return int(trusted.anode_send(profile, f.anode[i], now, payload, length, w.entry))
    return int(trusted.anode_actuate(profile, f.anode[i], now, payload, length, w.entry))


@kernel
def record(f: Fleet, i: int, w: Work, length: int) -> None:
    """Log the entry in `w.entry`, where there are logs."""
    if f.settings[0].profile != PLAIN:
        log.append(f, i, w.entry, length)


@kernel
def take(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Chain as `chain` does, and log the entry unless it is audit traffic."""
    n = chain(f, i, w, kind, now, payload, length)
    if n > 0 and (kind in (INPUT, ACMD) or not int(payload[0]) & request.AUDIT):
        record(f, i, w, n)
    return n
