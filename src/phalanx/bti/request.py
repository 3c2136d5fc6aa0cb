"""The audit request: its contents, its transfer in fragments, and the limits on accepting requests.

A request is the record `request` of phalanx.wire.table, then its tokens, the start and the segment of the log, and
nothing more. Source: RoboRebound §3.7; docs/spec/rebound.md.
"""

from __future__ import annotations

from phalanx.config.bti import MOST_FRAGMENTS
from phalanx.kernel import kernel
from phalanx.pool import NO_ROW, borrow, give_back
from phalanx.wire import table
from phalanx.wire.fields import Row, copy, get_u16, put_u16, put_u32
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from .fleet import PENDING, START, Fleet
from .log import read
from .rounds import flush_marks, next_candidate, peer_at, withdraw

VERSION = table.REQUEST_VERSION
AT_FLAGS, AT_AUDITEE, AT_T, AT_TOP_A, AT_TREQ_MAC = map(
    table.REQUEST.at, ("flags", "auditee", "t", "top_a", "treq_mac")
)
AT_TOP_S, AT_AUTH_S, AT_AUTH_A = map(table.REQUEST.at, ("top_s", "auth_s_mac", "auth_a_mac"))
AT_HCKPT, AT_TOKENS = map(table.REQUEST.at, ("hckpt", "tokens"))
AT_CHECKPOINT_LEN, AT_SEGMENT_LEN = map(table.REQUEST.at, ("start_length", "segment_length"))
HEAD_BYTES = table.REQUEST.size
TOKEN_AUDITOR, TOKEN_T, TOKEN_MAC = map(table.COVERING_TOKEN.at, ("auditor", "t", "mac"))
TOKEN_BYTES = table.COVERING_TOKEN.size

AUDIT = table.KIND_AUDIT
HELLO, FRAGMENT, TOKEN = table.HELLO, table.FRAGMENT, table.TOKEN_REPLY
AUDIT_HEAD_BYTES = table.AUDIT_HEADER_BYTES
FRAGMENT_HEAD_BYTES = table.AUDIT_FRAGMENT.size
TOKEN_FRAME_BYTES = table.AUDIT_TOKEN.size
AT_SRC, AT_DST, AT_SUB = map(table.AUDIT_HELLO.at, ("src", "dst", "sub"))
AT_REQUEST, AT_INDEX, AT_COUNT = map(table.AUDIT_FRAGMENT.at, ("request", "index", "count"))
REPLY_T, REPLY_MAC = map(table.AUDIT_TOKEN.at, ("t", "mac"))
AUTH_MAC = table.AUTHENTICATOR.at("mac")
TREQ_BYTES = table.TOKEN_REQUEST.size
# A fragment that the radio or the a-node did not accept is sent again after T_audit >> POSTPONED.
POSTPONED = 5


@kernel
def is_audit(packet: Row, length: int) -> bool:
    """Return whether a packet is an AUDIT packet with a complete header."""
    return length >= AUDIT_HEAD_BYTES and int(packet[0]) & AUDIT != 0


@kernel
def is_fragment(packet: Row, length: int) -> bool:
    """Return whether a packet is a fragment of a request; its sender waits until the radio has sent it."""
    return is_audit(packet, length) and packet[AT_SUB] == FRAGMENT


@kernel
def make_request(f: Fleet, i: int, now: int, treq: Row, auth_s: Row, auth_a: Row) -> int:
    """Write a request to the next auditor into the robot's row of `f.request`.

    `treq` (32,), `auth_s` (30,) and `auth_a` (30,) are scratch.

    Returns: its length; 0 if no auditor is left, none is due or the log is full; negative: the a-node's error.
    Source: RoboRebound §3.7.
    """
    r = f.robot[i]
    if r.quota <= 0 or r.log_full == 1 or r.request_len > 0:
        return 0
    auditor = next_candidate(f, i, now)
    if auditor == 0:
        return 0
    code = flush_marks(f, i, treq, auth_s, auth_a, auditor, now)
    if code < 0:
        r.quota = 0
        return code
    asked = f.peer[i, peer_at(f, i, auditor)]
    asked.asked = r.round_no
    asked.asked_ms = now
    asked.claimed = r.checkpoint_no
    r.quota -= 1
    r.request_no = (int(r.request_no) + 1) & 0xFFFF
    r.request_to = auditor
    r.request_next = 0
    r.repeats = 0
    r.repeat_at = now
    r.asked_at = now
    r.request_len = _write(f, i, treq, auth_s, auth_a)
    r.requests_sent += 1
    return int(r.request_len)


@kernel
def _write(f: Fleet, i: int, treq: Row, auth_s: Row, auth_a: Row) -> int:
    r, out = f.robot[i], f.request.rows[row_of(f, i)]
    tokens = 0 if r.booted == 1 else f.settings[0].f_max + 1
    length = HEAD_BYTES + tokens * TOKEN_BYTES + r.start_len + r.log_len
    if length > out.shape[0]:
        return 0
    out[0] = VERSION
    out[AT_FLAGS] = r.booted
    put_u16(out, AT_AUDITEE, int(r.id))
    copy(out, AT_T, treq, 0, TREQ_BYTES)  # both records have the same fields from t to the MAC
    copy(out, AT_TOP_S, auth_s, 0, HASH_BYTES)
    copy(out, AT_AUTH_S, auth_s, AUTH_MAC, MAC_BYTES)
    copy(out, AT_AUTH_A, auth_a, AUTH_MAC, MAC_BYTES)
    copy(out, AT_HCKPT, f.hckpt[i, PENDING], 0, HASH_BYTES)
    out[AT_TOKENS] = tokens
    put_u16(out, AT_CHECKPOINT_LEN, r.start_len)
    put_u32(out, AT_SEGMENT_LEN, r.log_len)
    at = HEAD_BYTES
    for k in range(tokens):
        token = f.token[i, START, k]
        put_u16(out, at + TOKEN_AUDITOR, token.auditor)
        put_u32(out, at + TOKEN_T, token.t)
        copy(out, at + TOKEN_MAC, token.mac, 0, MAC_BYTES)
        at += TOKEN_BYTES
    copy(out, at, f.checkpoint[i, START], 0, r.start_len)
    read(f, i, r.log_len, out, at + r.start_len)
    return int(length)


@kernel
def row_of(f: Fleet, i: int) -> int:
    """Return the robot's row of `f.request`; allocate one if needed, until the request is withdrawn."""
    r = f.robot[i]
    if r.request_row == NO_ROW:
        r.request_row = borrow(f.request)
    return int(r.request_row)


@kernel
def audit_head(packet: Row, src: int, dst: int, sub: int) -> None:
    """Write the header of an AUDIT packet; `dst` 0 is a broadcast. Source: docs/spec/rebound.md."""
    packet[0] = AUDIT
    put_u16(packet, AT_SRC, src)
    put_u16(packet, AT_DST, dst)
    packet[AT_SUB] = sub


@kernel
def next_fragment(f: Fleet, i: int, now: int, packet: Row) -> int:
    """Write the next fragment of the current request; return its length, 0 if all are sent or the next must wait.

    Source: RoboRebound §3.7.
    """
    r = f.robot[i]
    body = f.settings[0].packet_max - FRAGMENT_HEAD_BYTES
    count = (r.request_len + body - 1) // body
    if r.request_len == 0 or r.request_next >= count:
        withdraw(f, i)
        return 0
    if now < r.repeat_at:
        return 0
    audit_head(packet, int(r.id), int(r.request_to), FRAGMENT)
    put_u16(packet, AT_REQUEST, int(r.request_no))
    packet[AT_INDEX] = r.request_next
    packet[AT_COUNT] = count
    begin = r.request_next * body
    length = min(body, r.request_len - begin)
    copy(packet, FRAGMENT_HEAD_BYTES, f.request.rows[r.request_row], begin, length)
    r.request_next += 1
    return int(FRAGMENT_HEAD_BYTES + length)


@kernel
def postpone(f: Fleet, i: int, now: int) -> int:
    """Handle a fragment that the radio or the a-node did not accept; return when to go on, ms of the robot's clock.

    The fragment waits, and its token request stays valid. But if the auditor has acknowledged nothing, and another one
    has answered SEEK and was not asked in this round, the robot asks that one. Otherwise compromised robots that never
    acknowledge could use up this robot's airtime and its few token requests, and so stop it (docs/adr/0039).
    """
    r = f.robot[i]
    if r.seeks and r.repeats > 0 and r.request_next <= 1:
        other = next_candidate(f, i, now)
        if other != 0 and f.peer[i, peer_at(f, i, other)].asked != r.round_no:
            withdraw(f, i)
            r.quota += 1
            r.retry_at = now + 1
            return int(r.retry_at)
    r.request_next = max(r.request_next - 1, 0)
    r.repeat_at = now + max(1, f.settings[0].t_audit >> POSTPONED)
    r.retry_at = r.repeat_at
    return int(r.repeat_at)


@kernel
def hello(f: Fleet, i: int, packet: Row) -> int:
    """Write a HELLO, the broadcast that announces this robot as an auditor; return its length."""
    audit_head(packet, int(f.robot[i].id), 0, HELLO)
    return AUDIT_HEAD_BYTES


@kernel
def new_token(f: Fleet, i: int, to: int, number: int, t: int, mac: Row, packet: Row) -> int:
    """Write the reply with a token to request `number` of robot `to`; return its length.

    The token is stored, so that it can be sent again if it is lost. `t` is the token request's time, ms; `mac` (8,) is
    the token's.
    """
    at = peer_at(f, i, to)
    if at >= 0:
        o = f.owed[i, at]
        o.t, o.no = t, number
        copy(o.mac, 0, mac, 0, MAC_BYTES)
    return int(token_packet(f, i, to, number, t, mac, packet))


@kernel
def token_packet(f: Fleet, i: int, to: int, number: int, t: int, mac: Row, packet: Row) -> int:
    """Write the reply with a token to robot `to`; return its length. The arguments are those of `new_token`."""
    audit_head(packet, int(f.robot[i].id), to, TOKEN)
    put_u16(packet, AT_REQUEST, number)
    put_u32(packet, REPLY_T, t)
    copy(packet, REPLY_MAC, mac, 0, MAC_BYTES)
    return TOKEN_FRAME_BYTES


@kernel
def take_fragment(f: Fleet, i: int, packet: Row, length: int, now: int) -> int:
    """Store a fragment of another robot's request.

    Returns: the index in `f.rx_info[i]` of a request that is now complete, or -1. Its row of `f.rx` is released, but
        stays unchanged until the next fragment arrives.
    Source: docs/spec/rebound.md (bounded memory; one request at a time per sender).
    """
    if length < FRAGMENT_HEAD_BYTES + 1:
        return -1
    src, no = get_u16(packet, AT_SRC), get_u16(packet, AT_REQUEST)
    index, count = int(packet[AT_INDEX]), int(packet[AT_COUNT])
    body = f.settings[0].packet_max - FRAGMENT_HEAD_BYTES
    size = length - FRAGMENT_HEAD_BYTES
    if (
        index >= count
        or count > MOST_FRAGMENTS
        or index * body + size > f.rx.rows.shape[1]
        or (index < count - 1 and size != body)
    ):
        return -1
    at = _place(f, i, src)
    x = f.rx_info[i, at]
    if x.src != src or x.no != no or x.count != count:
        if not _may_begin(f, i, src, now):
            return -1
        if x.src == 0:
            x.row = borrow(f.rx)
        x.src = src
        x.no = no
        x.count = count
        x.have = 0
        x.len = 0
    x.at = now
    x.have |= 1 << index
    copy(f.rx.rows[x.row], index * body, packet, FRAGMENT_HEAD_BYTES, size)
    if index == count - 1:
        x.len = index * body + size
    if x.have != (1 << count) - 1:
        return -1
    x.src = 0
    give_back(f.rx, x.row)
    return at


@kernel
def _place(f: Fleet, i: int, src: int) -> int:
    """Return the index of the sender's request, or of a free entry, or of the request that has been idle for longest.

    A new request is never rejected for lack of space: f_max compromised robots that begin requests without completing
    them would otherwise block all entries for ever.
    """
    oldest = 0
    for k in range(f.rx_info.shape[1]):
        x = f.rx_info[i, k]
        if x.src == src:
            return k
        if f.rx_info[i, oldest].src != 0 and (x.src == 0 or x.at < f.rx_info[i, oldest].at):
            oldest = k
    return oldest


@kernel
def _may_begin(f: Fleet, i: int, src: int, now: int) -> bool:
    """Return whether `src` may begin a request: one per T_audit / 2, completed or not. Source: RoboRebound §5.1."""
    at = peer_at(f, i, src)
    if at < 0 or now - f.peer[i, at].took < f.settings[0].t_audit // 2:
        return False
    f.peer[i, at].took = now
    return True


@kernel
def admit(f: Fleet, i: int, src: int, t: int, now: int) -> bool:
    """Return whether to audit one more request: not a repeated one, and within what n_max neighbours may ask in T_val.

    One neighbour cannot use another's share: `take_fragment` begins one request of each per T_audit / 2.
    Source: RoboRebound §5.1, where the limit is 6 f_max; docs/adr/0027.
    """
    r, s = f.robot[i], f.settings[0]
    oldest = r.accepted % f.taken.shape[1]
    at = peer_at(f, i, src)
    if at < 0 or t <= f.peer[i, at].took_t or now - f.taken[i, oldest] < s.t_val:
        return False
    f.peer[i, at].took_t = t
    f.taken[i, oldest] = now
    r.accepted += 1
    return True
