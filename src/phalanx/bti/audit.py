"""The auditor: ordered checks of one request, each a pure function of the bytes shown.

The checks come in the order of docs/spec/rebound.md: the start, the authenticators, the entries and both chains, the
replay, the state at the checkpoint. The replay runs the controller, which is in phalanx.robot: its caller repeats
`next_event` and, after an INPUT, `expect`. Time and memory are bounded by the length of the request.
Source: RoboRebound §3.7.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire import table
from phalanx.wire.fields import (
    OUTPUT_HEAD_BYTES,
    OUTPUT_LENGTH,
    Row,
    copy,
    get_u16,
    get_u32,
    put_u16,
    put_u32,
    same,
)
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from . import log, memo, request, rounds, trusted
from .fleet import HARDENED, PAPER, Fleet
from .log import CHECKPOINT, ENTRY_HEAD_BYTES, ENTRY_LENGTH, ENTRY_T, EVIDENCE, FLUSH_A, FLUSH_S, MARK
from .refusal import Refusal
from .work import Work

INPUT, RECV, SEND, ACMD = table.ENTRY_INPUT, table.ENTRY_RECV, table.ENTRY_SEND, table.ENTRY_ACMD
END = 0


@kernel
def open_request(w: Work, q: Row, length: int, src: int) -> int:
    """Parse a request into `w.case`: its parts must fill it exactly, and its sender must be the auditee it names.

    Returns: 0 or a `Refusal`. Source: docs/spec/rebound.md.
    """
    if length < request.HEAD_BYTES or q[0] != request.VERSION or q[request.AT_FLAGS] > 1:
        return Refusal.MALFORMED
    c = w.case[0]
    c.auditee = get_u16(q, request.AT_AUDITEE)
    c.t = get_u32(q, request.AT_T)
    c.tokens = q[request.AT_TOKENS]
    c.start_len = get_u16(q, request.AT_CHECKPOINT_LEN)
    segment = get_u32(q, request.AT_SEGMENT_LEN)
    c.start_at = request.HEAD_BYTES + c.tokens * request.TOKEN_BYTES
    c.at = c.start_at + c.start_len
    c.end = c.at + segment
    c.waiting = 0
    if c.end != length or c.auditee == 0:
        return Refusal.MALFORMED
    if q[request.AT_FLAGS] and (c.start_len != rounds.BOOTED_BYTES or c.tokens != 0):
        return Refusal.MALFORMED
    if q[request.AT_FLAGS] == 0 and (c.start_len < rounds.CHECKPOINT_BYTES or c.start_len > w.state.shape[0]):
        return Refusal.MALFORMED
    if c.auditee != src:
        return Refusal.NOT_THE_SENDER
    c.step = 0 if q[request.AT_FLAGS] else get_u32(q, c.start_at + rounds.AT_STEP)
    c.due = get_u32(q, c.start_at + (rounds.AT_T_KEY if q[request.AT_FLAGS] else rounds.AT_DUE))
    return 0


@kernel
def examine(f: Fleet, i: int, w: Work, q: Row, length: int, src: int) -> int:
    """Run all checks that come before the replay. Returns: 0 or a `Refusal`. Source: RoboRebound §3.7."""
    refused = open_request(w, q, length, src)
    if refused == 0:
        refused = check_start(f, i, w, q)
    if refused == 0:
        refused = check_authenticators(f, i, w, q)
    if refused == 0:
        refused = check_chains(f, w, q)
    return int(refused)


@kernel
def check_start(f: Fleet, i: int, w: Work, q: Row) -> int:
    """Check that the log starts at boot, or at a checkpoint with f_max + 1 tokens. Source: RoboRebound §3.6, §3.7."""
    c, s = w.case[0], f.settings[0]
    c.newest = -1
    c.checkpoints = 0
    c.marked = 0
    if q[request.AT_FLAGS]:
        # If the key's time were in the future, no reading would be due until then, and the checkpoint would confirm it.
        if c.due > c.t:
            return Refusal.OUT_OF_ORDER
        # Nodes forward nothing before they have the key: an entry older than the key shows that its time is false.
        c.newest = c.due
        c.due += rounds.phase_of(s.mission_seed, c.auditee, s.t_control)
        w.tops[:] = 0
    c.known = memo.recall(f.memo, w, q) if s.plain == 0 else 0
    if q[request.AT_FLAGS] or c.known:
        return 0
    if c.tokens < s.f_max + 1:
        return Refusal.TOO_FEW_TOKENS
    if c.tokens > 2 * s.f_max + 1:
        return Refusal.MALFORMED
    copy(w.state, 0, q, c.start_at, c.start_len)
    copy(w.tops[0], 0, w.state, rounds.AT_S_TOP, HASH_BYTES)
    copy(w.tops[1], 0, w.state, rounds.AT_A_TOP, HASH_BYTES)
    hckpt = w.small[3]
    trusted.sha1(w.state, c.start_len, hckpt)
    for k in range(c.tokens):
        at = request.HEAD_BYTES + k * request.TOKEN_BYTES
        auditor, t = get_u16(q, at + request.TOKEN_AUDITOR), get_u32(q, at + request.TOKEN_T)
        for other in range(k):
            if get_u16(q, request.HEAD_BYTES + other * request.TOKEN_BYTES + request.TOKEN_AUDITOR) == auditor:
                return Refusal.TOKEN_TWICE
        mac = q[at + request.TOKEN_MAC : at + request.TOKEN_BYTES]
        if trusted.anode_check_token(s.profile, f.anode[i], auditor, c.auditee, t, hckpt, mac) != 0:
            return Refusal.TOKEN_INVALID
    return 0


@kernel
def check_authenticators(f: Fleet, i: int, w: Work, q: Row) -> int:
    """Check that the trusted nodes authenticated the tops and, in `hardened`, did so for this token request.

    Source: RoboRebound Alg. 3; docs/spec/rebound.md (stale log).
    """
    auditee, s = w.case[0].auditee, f.settings[0]
    nonce = q[request.AT_TREQ_MAC : request.AT_TREQ_MAC + MAC_BYTES]
    top, mac = q[request.AT_TOP_S : request.AT_TOP_S + HASH_BYTES], q[request.AT_AUTH_S : request.AT_AUTH_S + MAC_BYTES]
    if trusted.snode_check_auth(s.profile, f.snode[i], top, auditee, nonce, mac) != 0:
        return Refusal.AUTHENTICATOR_INVALID
    if s.profile == PAPER:
        top = q[request.AT_TOP_A : request.AT_TOP_A + HASH_BYTES]
        mac = q[request.AT_AUTH_A : request.AT_AUTH_A + MAC_BYTES]
        if trusted.snode_check_auth_a(s.profile, f.snode[i], top, auditee, mac) != 0:
            return Refusal.AUTHENTICATOR_INVALID
    return 0


@kernel
def _flush(w: Work, chain: int) -> None:
    """Extend the s-chain (0) or the a-chain (1) with its batch."""
    if w.held[chain, 1] > 0:
        trusted.chain_extend(w.tops[chain], w.batch[chain], w.held[chain, 1])
    w.held[chain] = 0


@kernel
def check_chains(f: Fleet, w: Work, q: Row) -> int:  # noqa: C901, PLR0912 - one pass over the bytes
    """Check that entries are well formed, in order and complete, and that both chains hash to the tops shown.

    The tops at the checkpoint are then in `w.state`: the checkpoint's hash covers them.
    Source: RoboRebound §3.7, §3.8; docs/spec/rebound.md (free interleaving, starving the sensors).
    """
    c, s = w.case[0], f.settings[0]
    hardened = s.profile == HARDENED
    w.held[:] = 0
    at, newest, due, checkpoints, kind = c.at, c.newest, c.due, c.checkpoints, END
    while at < c.end:
        begin, before = at, kind
        kind, payload_at, at = log.piece_at(q, begin, c.end)
        size = at - payload_at
        if INPUT <= kind <= ACMD and 0 < size <= s.packet_max:
            t = get_u32(q, begin + ENTRY_T)
            if hardened:
                if t < newest - s.skew or t > c.t:
                    return Refusal.OUT_OF_ORDER
                newest = max(newest, t)
            if kind == INPUT:
                if hardened and (t < due - s.delta or t > due + s.delta):
                    return Refusal.INPUT_OFF_GRID
                due += s.t_control
            elif kind != ACMD and int(q[payload_at]) & MARK:
                return Refusal.AUDIT_FRAME_LOGGED
            chain = 0 if kind == INPUT else 1
            copy(w.batch[chain], w.held[chain, 1], q, begin, at - begin)
            w.held[chain, 0] += 1
            w.held[chain, 1] += at - begin
            if w.held[chain, 0] == s.batch_size:
                _flush(w, chain)
        elif kind in (FLUSH_S, FLUSH_A):
            _flush(w, kind - FLUSH_S)
        elif kind == CHECKPOINT:
            if w.held[0, 1] + w.held[1, 1] > 0:
                return Refusal.CHECKPOINT_NOT_FLUSHED
            checkpoints += 1
            copy(w.state, rounds.AT_S_TOP, w.tops[0], 0, HASH_BYTES)
            copy(w.state, rounds.AT_A_TOP, w.tops[1], 0, HASH_BYTES)
        elif kind == EVIDENCE:
            if before != INPUT or size == 0 or size > w.evidence.shape[0]:
                return Refusal.ENTRY_MALFORMED
        elif kind != log.ADVICE or size == 0:
            return Refusal.ENTRY_MALFORMED
    if hardened and due < c.t - s.delta:
        return Refusal.INPUT_MISSING
    if checkpoints != 1:
        return Refusal.CHECKPOINT_MISSING
    if w.held[0, 1] > 0 or not same(w.tops[0], 0, q, request.AT_TOP_S, HASH_BYTES):
        return Refusal.S_CHAIN
    if w.held[1, 1] > 0 or not same(w.tops[1], 0, q, request.AT_TOP_A, HASH_BYTES):
        return Refusal.A_CHAIN
    c.newest = newest
    return 0


@kernel
def next_event(f: Fleet, w: Work, q: Row) -> int:  # noqa: C901 - one branch per kind of item
    """Advance to the next item that the controller must process, and compare logged outputs on the way.

    Returns: INPUT or RECV, with `case.entry_t`, `payload_at`, `payload_len` and `evidence_len` set; ADVICE, with
        `payload_at` and `payload_len`; CHECKPOINT, with its fixed fields in `w.state`; END; or a negative `Refusal`.
    Source: RoboRebound §3.7.
    """
    c, s = w.case[0], f.settings[0]
    while c.at < c.end:
        begin = c.at
        kind, c.payload_at, c.at = log.piece_at(q, begin, c.end)
        last = c.at
        c.payload_len = last - c.payload_at
        c.evidence_len = 0
        if kind == INPUT and last < c.end and q[last] == EVIDENCE:
            _, evidence_at, c.at = log.piece_at(q, last, c.end)
            c.evidence_len = c.at - evidence_at
            copy(w.evidence, 0, q, evidence_at, c.evidence_len)
        c.marked = 0
        if kind == log.ADVICE:
            return log.ADVICE
        if kind & MARK:
            c.marked = 1
            if kind == CHECKPOINT:
                put_u32(w.state, rounds.AT_DUE, c.due)
                put_u32(w.state, rounds.AT_STEP, c.step)
                return -Refusal.OUTPUT_PENDING if c.waiting > 0 else CHECKPOINT
            continue
        c.entry_t = get_u32(q, begin + ENTRY_T)
        if s.profile == HARDENED and c.waiting > 0 and c.entry_t > get_u32(w.waiting, ENTRY_T) + s.delta:
            return -Refusal.OUTPUT_LATE
        if kind <= RECV:
            return int(kind)
        if c.waiting == 0:
            return -Refusal.OUTPUT_UNCALLED
        # Compare with the first expected output, from the length on: its time is that of its cause.
        length = last - begin
        if w.waiting[0] != kind or not same(w.waiting, ENTRY_LENGTH, q, begin + ENTRY_LENGTH, length - ENTRY_LENGTH):
            return -Refusal.OUTPUT_WRONG
        c.waiting -= length
        copy(w.waiting, 0, w.waiting, length, c.waiting)
    if c.waiting > 0 and (s.profile == PAPER or c.t > get_u32(w.waiting, ENTRY_T) + s.delta):
        return -Refusal.OUTPUT_MISSING
    return END


@kernel
def expect(f: Fleet, w: Work, length: int) -> int:
    """Expect the controller's outputs in `w.out[:length]` next in the log; return 0 or a `Refusal`.

    Source: docs/spec/rebound.md.
    """
    c = w.case[0]
    c.step += 1
    c.due += f.settings[0].t_control
    at = 0
    while at < length:
        size = get_u16(w.out, at + OUTPUT_LENGTH)
        if c.waiting + ENTRY_HEAD_BYTES + size > w.waiting.shape[0]:
            return Refusal.OUTPUT_MISSING
        w.waiting[c.waiting] = w.out[at]
        put_u32(w.waiting, c.waiting + ENTRY_T, c.entry_t)
        put_u16(w.waiting, c.waiting + ENTRY_LENGTH, size)
        copy(w.waiting, c.waiting + ENTRY_HEAD_BYTES, w.out, at + OUTPUT_HEAD_BYTES, size)
        c.waiting += ENTRY_HEAD_BYTES + size
        at += OUTPUT_HEAD_BYTES + size
    return 0


@kernel
def check_state(w: Work, q: Row, state_len: int) -> int:
    """Check that the replayed state, `state_len` bytes in `w.state`, has the claimed hash. Source: RoboRebound §3.7."""
    hckpt = w.small[3]
    trusted.sha1(w.state, rounds.CHECKPOINT_BYTES + state_len, hckpt)
    if not same(hckpt, 0, q, request.AT_HCKPT, HASH_BYTES):
        return Refusal.CHECKPOINT_WRONG
    return 0


@kernel
def issue(f: Fleet, i: int, w: Work, q: Row, mac: Row) -> int:
    """Let the auditor's a-node issue a token for the auditee's log up to this request; write its MAC to `mac` (8,).

    Returns: 0 or `Refusal.REQUEST_INVALID`. Source: RoboRebound Alg. 4.
    """
    c = w.case[0]
    top = q[request.AT_TOP_A : request.AT_TOP_A + HASH_BYTES]
    hckpt = q[request.AT_HCKPT : request.AT_HCKPT + HASH_BYTES]
    treq = q[request.AT_TREQ_MAC : request.AT_TREQ_MAC + MAC_BYTES]
    code = trusted.anode_issue_token(f.settings[0].profile, f.anode[i], c.auditee, c.t, top, treq, hckpt, mac)
    return 0 if code >= 0 else Refusal.REQUEST_INVALID
