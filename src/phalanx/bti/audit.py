"""The auditor: ordered checks over one request, each a pure function of the bytes shown.

The checks come in the order of docs/spec/rebound.md: the start, the authenticators, the entries and both chains, the
replay, the state at the checkpoint. The replay itself needs the controller, which lives a floor higher: whoever runs
it calls `next_event` and, after an INPUT, `expect`. Time and memory are bounded by the length of the request.
Source: RoboRebound §3.7.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.bundle import pack, reference
from phalanx.config import BtiConfig
from phalanx.kernel import kernel
from phalanx.wire.fields import Row, copy, get_u16, get_u32, put_u32, same
from phalanx.wire.table import ENTRY_ACMD, ENTRY_HEADER_BYTES, ENTRY_INPUT, ENTRY_RECV, ENTRY_SEND

from . import trusted
from .fleet import BOUND, PAPER, Fleet, records
from .log import CHECKPOINT, EVIDENCE, EVIDENCE_HEAD_BYTES, FLUSH_A, FLUSH_S, MARK
from .refusal import Refusal
from .request import (
    AT_AUTH_A,
    AT_AUTH_S,
    AT_CHECKPOINT_LEN,
    AT_HCKPT,
    AT_SEGMENT_LEN,
    AT_T,
    AT_TEE,
    AT_TOKENS,
    AT_TOP_A,
    AT_TOP_S,
    AT_TREQ_MAC,
    HEAD_BYTES,
    TOKEN_BYTES,
    VERSION,
)
from .rounds import phase_of

INPUT, RECV, SEND, ACMD = ENTRY_INPUT, ENTRY_RECV, ENTRY_SEND, ENTRY_ACMD
END = 0
ENTRY_HEAD_BYTES = ENTRY_HEADER_BYTES
# An expected output waits as: type u8, length u16, the cause's t as 4 bytes, payload.
WAITING_HEAD_BYTES = 7

CASE = np.dtype(
    [
        ("tee", "i8"),
        ("t", "i8"),  # of the token request
        ("tokens", "i8"),
        ("start_at", "i8"),
        ("start_len", "i8"),
        ("at", "i8"),  # where in the request the replay stands
        ("end", "i8"),
        ("step", "i8"),
        ("due", "i8"),  # of the next INPUT, ms of the auditee's clock
        ("entry_t", "i8"),
        ("payload_at", "i8"),
        ("payload_len", "i8"),
        ("evidence_len", "i8"),  # of the INPUT's, in `work.evidence`
        ("waiting", "i8"),  # bytes of expected outputs in `work.waiting`
    ],
    align=True,
)


class Work(NamedTuple):
    """Scratch memory of one auditor at a time.

    Args:
        case: (1,) CASE, how far the audit is.
        batch_s, batch_a: entries not hashed yet.
        tops: (4, 20): s- and a-chain while they are re-hashed, and at the checkpoint.
        state: the replayed controller's state, behind 48 bytes for the rest of a checkpoint.
        out: outputs of one step of the controller.
        waiting: outputs that the log still has to show.
        evidence: what the log keeps beside the INPUT; as long as the longest that is read, 0 where there is none.
        small: (4, 32): token requests, authenticators, hashes.
        frame, entry: a radio frame and a chained entry.
        told: (8,) int64: what happened, for whoever called (see robot/node.py).
    """

    case: NDArray[Any]
    batch_s: NDArray[np.uint8]
    batch_a: NDArray[np.uint8]
    tops: NDArray[np.uint8]
    state: NDArray[np.uint8]
    out: NDArray[np.uint8]
    waiting: NDArray[np.uint8]
    evidence: NDArray[np.uint8]
    small: NDArray[np.uint8]
    frame: NDArray[np.uint8]
    entry: NDArray[np.uint8]
    told: NDArray[np.int64]


WorkType, WorkRef = reference(Work)


@kernel
def _refer(work: Work) -> Any:
    return WorkRef(*work)


def make_work(config: BtiConfig) -> Work:
    """Scratch memory for fleets of this configuration."""
    entry = ENTRY_HEAD_BYTES + config.frame_max_bytes
    work = Work(
        case=records(1, CASE),
        batch_s=np.zeros(config.batch_size * entry, np.uint8),
        batch_a=np.zeros(config.batch_size * entry, np.uint8),
        tops=np.zeros((4, 20), np.uint8),
        state=np.zeros(config.checkpoint_capacity_bytes + 48, np.uint8),
        out=np.zeros(2 * entry, np.uint8),
        waiting=np.zeros(4 * entry, np.uint8),
        evidence=np.zeros(config.evidence_max_bytes, np.uint8),
        small=np.zeros((4, 32), np.uint8),
        frame=np.zeros(entry, np.uint8),
        entry=np.zeros(entry, np.uint8),
        told=np.zeros(8, np.int64),
    )
    return pack(work, _refer)


@kernel
def open_request(w: Work, q: Row, length: int) -> int:
    """The request's parts are found and fill it exactly; `w.case` is set. Source: docs/spec/rebound.md."""
    if length < HEAD_BYTES or q[0] != VERSION or q[1] > 1:
        return Refusal.MALFORMED
    c = w.case[0]
    c.tee = get_u16(q, AT_TEE)
    c.t = get_u32(q, AT_T)
    c.tokens = q[AT_TOKENS]
    c.start_len = get_u16(q, AT_CHECKPOINT_LEN)
    segment = get_u32(q, AT_SEGMENT_LEN)
    c.start_at = HEAD_BYTES + c.tokens * TOKEN_BYTES
    c.at = c.start_at + c.start_len
    c.end = c.at + segment
    c.waiting = 0
    if c.end != length or c.tee == 0:
        return Refusal.MALFORMED
    if q[1] == 1 and (c.start_len != 4 or c.tokens != 0):
        return Refusal.MALFORMED
    if q[1] == 0 and (c.start_len < 48 or c.start_len > w.state.shape[0]):
        return Refusal.MALFORMED
    return 0


@kernel
def check_start(f: Fleet, i: int, w: Work, q: Row) -> int:
    """The log begins at boot, or at a checkpoint that f_max + 1 auditors vouch for. Source: RoboRebound §3.6, §3.7."""
    c, s = w.case[0], f.settings[0]
    if q[1] == 1:
        c.step = 0
        # A mission key of tomorrow would make no reading due until then, and the checkpoint would vouch for it.
        if get_u32(q, c.start_at) > c.t:
            return Refusal.OUT_OF_ORDER
        c.due = get_u32(q, c.start_at) + phase_of(s.mission_seed, c.tee, s.t_control)
        w.tops[0:2] = 0
        return 0
    if c.tokens < s.f_max + 1:
        return Refusal.TOO_FEW_TOKENS
    if c.tokens > 2 * s.f_max + 1:
        return Refusal.MALFORMED
    hckpt = w.small[3]
    copy(w.state, 0, q, c.start_at, c.start_len)
    trusted.sha1(w.state, c.start_len, hckpt)
    for k in range(c.tokens):
        at = HEAD_BYTES + k * TOKEN_BYTES
        tor = get_u16(q, at)
        for other in range(k):
            if get_u16(q, HEAD_BYTES + other * TOKEN_BYTES) == tor:
                return Refusal.TOKEN_TWICE
        t = get_u32(q, at + 2)
        if trusted.anode_check_token(s.profile, f.anode[i], tor, c.tee, t, hckpt, q[at + 6 : at + 14]) != 0:
            return Refusal.TOKEN_INVALID
    c.due = get_u32(q, c.start_at)
    c.step = get_u32(q, c.start_at + 4)
    copy(w.tops[0], 0, q, c.start_at + 8, 20)
    copy(w.tops[1], 0, q, c.start_at + 28, 20)
    return 0


@kernel
def check_authenticators(f: Fleet, i: int, w: Work, q: Row) -> int:
    """The tops shown are the trusted nodes' own and, in `bound`, of the moment of this very token request.

    Source: RoboRebound Alg. 3; docs/spec/rebound.md (stale log).
    """
    tee, s = w.case[0].tee, f.settings[0]
    nonce = q[AT_TREQ_MAC : AT_TREQ_MAC + 8]
    top, mac = q[AT_TOP_S : AT_TOP_S + 20], q[AT_AUTH_S : AT_AUTH_S + 8]
    if trusted.snode_check_auth(s.profile, f.snode[i], top, tee, nonce, mac) != 0:
        return Refusal.AUTHENTICATOR_INVALID
    if s.profile == PAPER:
        top, mac = q[AT_TOP_A : AT_TOP_A + 20], q[AT_AUTH_A : AT_AUTH_A + 8]
        if trusted.snode_check_auth_a(s.profile, f.snode[i], top, tee, mac) != 0:
            return Refusal.AUTHENTICATOR_INVALID
    return 0


@kernel
def _batched(w_batch: Row, n: int, q: Row, at: int, length: int) -> int:
    copy(w_batch, n, q, at, length)
    return n + length


@kernel
def check_chains(f: Fleet, w: Work, q: Row) -> int:  # noqa: C901, PLR0912, PLR0915 - one pass over the bytes
    """The entries are well formed, in order and complete, and both chains re-hash to the tops shown.

    Source: RoboRebound §3.7, §3.8; docs/spec/rebound.md (free interleaving, starving the sensors).
    """
    c, s = w.case[0], f.settings[0]
    bound = s.profile == BOUND
    s_n, s_len, a_n, a_len = 0, 0, 0, 0
    at, newest, due, checkpoints = c.at, -1, c.due, 0
    if q[1] == 1:
        # Nodes forward nothing before they have the key: who claims it came later than it did has heard too early.
        newest = get_u32(q, c.start_at)
    longest = ENTRY_HEAD_BYTES + s.frame_max
    after_input = False
    while at < c.end:
        kind = q[at]
        if kind == EVIDENCE:
            size = get_u16(q, at + 1) if after_input and at + EVIDENCE_HEAD_BYTES <= c.end else 0
            if size == 0 or size > w.evidence.shape[0] or at + EVIDENCE_HEAD_BYTES + size > c.end:
                return Refusal.ENTRY_MALFORMED
            after_input = False
            at += EVIDENCE_HEAD_BYTES + size
            continue
        after_input = kind == INPUT
        if kind & MARK:
            if kind == FLUSH_S:
                if s_len > 0:
                    trusted.chain_extend(w.tops[0], w.batch_s, s_len)
                s_n, s_len = 0, 0
            elif kind == FLUSH_A:
                if a_len > 0:
                    trusted.chain_extend(w.tops[1], w.batch_a, a_len)
                a_n, a_len = 0, 0
            elif kind == CHECKPOINT:
                if s_len + a_len > 0:
                    return Refusal.CHECKPOINT_NOT_FLUSHED
                checkpoints += 1
                copy(w.tops[2], 0, w.tops[0], 0, 20)
                copy(w.tops[3], 0, w.tops[1], 0, 20)
            else:
                return Refusal.ENTRY_MALFORMED
            at += 1
            continue
        if at + ENTRY_HEAD_BYTES > c.end or kind < INPUT or kind > ACMD:
            return Refusal.ENTRY_MALFORMED
        t = get_u32(q, at + 1)
        length = ENTRY_HEAD_BYTES + get_u16(q, at + 5)
        if at + length > c.end or length > longest or length == ENTRY_HEAD_BYTES:
            return Refusal.ENTRY_MALFORMED
        if bound:
            if t < newest - s.skew or t > c.t:
                return Refusal.OUT_OF_ORDER
            newest = max(newest, t)
        if kind == INPUT:
            if bound and (t < due - s.delta or t > due + s.delta):
                return Refusal.INPUT_OFF_GRID
            due += s.t_control
            s_len = _batched(w.batch_s, s_len, q, at, length)
            s_n += 1
            if s_n == s.batch_size:
                trusted.chain_extend(w.tops[0], w.batch_s, s_len)
                s_n, s_len = 0, 0
        else:
            if kind != ACMD and q[at + ENTRY_HEAD_BYTES] & MARK:
                return Refusal.AUDIT_FRAME_LOGGED
            a_len = _batched(w.batch_a, a_len, q, at, length)
            a_n += 1
            if a_n == s.batch_size:
                trusted.chain_extend(w.tops[1], w.batch_a, a_len)
                a_n, a_len = 0, 0
        at += length
    if bound and due < c.t - s.delta:
        return Refusal.INPUT_MISSING
    if checkpoints != 1:
        return Refusal.CHECKPOINT_MISSING
    if s_len > 0 or not same(w.tops[0], 0, q, AT_TOP_S, 20):
        return Refusal.S_CHAIN
    if a_len > 0 or not same(w.tops[1], 0, q, AT_TOP_A, 20):
        return Refusal.A_CHAIN
    return 0


@kernel
def next_event(f: Fleet, w: Work, q: Row) -> int:
    """The replay goes on to the next entry that the controller must see, comparing outputs on its way.

    Returns: INPUT or RECV with `case.entry_t`, `payload_at`, `payload_len` and `evidence_len` set; CHECKPOINT; END; or
        minus a refusal.
    Source: RoboRebound §3.7.
    """
    c, s = w.case[0], f.settings[0]
    while c.at < c.end:
        kind = q[c.at]
        if kind & MARK:
            c.at += 1
            if kind == CHECKPOINT:
                return -Refusal.OUTPUT_PENDING if c.waiting > 0 else CHECKPOINT
            continue
        c.entry_t = get_u32(q, c.at + 1)
        c.payload_at = c.at + ENTRY_HEAD_BYTES
        c.payload_len = get_u16(q, c.at + 5)
        c.at = c.payload_at + c.payload_len
        c.evidence_len = 0
        if kind == INPUT and c.at < c.end and q[c.at] == EVIDENCE:
            c.evidence_len = get_u16(q, c.at + 1)
            copy(w.evidence, 0, q, c.at + EVIDENCE_HEAD_BYTES, c.evidence_len)
            c.at += EVIDENCE_HEAD_BYTES + c.evidence_len
        if s.profile == BOUND and c.waiting > 0 and c.entry_t > get_u32(w.waiting, 3) + s.delta:
            return -Refusal.OUTPUT_LATE
        if kind <= RECV:
            return int(kind)
        refused = _compare(w, q, kind)
        if refused:
            return -refused
    if c.waiting > 0 and (s.profile == PAPER or c.t > get_u32(w.waiting, 3) + s.delta):
        return -Refusal.OUTPUT_MISSING
    return END


@kernel
def _compare(w: Work, q: Row, kind: int) -> int:
    """A logged output is the first one that replay still waits for."""
    c = w.case[0]
    if c.waiting == 0:
        return Refusal.OUTPUT_UNCALLED
    length = get_u16(w.waiting, 1)
    if w.waiting[0] != kind or length != c.payload_len:
        return Refusal.OUTPUT_WRONG
    if not same(w.waiting, WAITING_HEAD_BYTES, q, c.payload_at, length):
        return Refusal.OUTPUT_WRONG
    used = WAITING_HEAD_BYTES + length
    copy(w.waiting, 0, w.waiting, used, c.waiting - used)
    c.waiting -= used
    return 0


@kernel
def expect(f: Fleet, w: Work, length: int) -> int:
    """The controller's outputs in `w.out[:length]` have to come next in the log. Source: docs/spec/rebound.md."""
    c = w.case[0]
    c.step += 1
    c.due += f.settings[0].t_control
    at = 0
    while at < length:
        size = get_u16(w.out, at + 1)
        if c.waiting + WAITING_HEAD_BYTES + size > w.waiting.shape[0]:
            return Refusal.OUTPUT_MISSING
        w.waiting[c.waiting] = w.out[at]
        copy(w.waiting, c.waiting + 1, w.out, at + 1, 2)
        put_u32(w.waiting, c.waiting + 3, c.entry_t)
        copy(w.waiting, c.waiting + WAITING_HEAD_BYTES, w.out, at + 3, size)
        c.waiting += WAITING_HEAD_BYTES + size
        at += 3 + size
    return 0


@kernel
def check_state(w: Work, q: Row, state_len: int) -> int:
    """The replayed state, `w.state[48:48 + state_len]`, is what the claimed hash covers. Source: RoboRebound §3.7."""
    c = w.case[0]
    put_u32(w.state, 0, c.due)
    put_u32(w.state, 4, c.step)
    copy(w.state, 8, w.tops[2], 0, 20)
    copy(w.state, 28, w.tops[3], 0, 20)
    hckpt = w.small[3]
    trusted.sha1(w.state, 48 + state_len, hckpt)
    if not same(hckpt, 0, q, AT_HCKPT, 20):
        return Refusal.CHECKPOINT_WRONG
    return 0
