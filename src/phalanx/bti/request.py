"""The audit request: what an auditee shows, and its way through radio frames of bounded length.

The record `request` of phalanx.wire.table, then its tokens, the start and the segment of the log; a longer or shorter
one is malformed. Source: RoboRebound §3.7; docs/spec/rebound.md.
"""

from __future__ import annotations

from phalanx.config.bti import MOST_FRAGMENTS
from phalanx.kernel import kernel
from phalanx.pool import NO_ROW, give_back, lend
from phalanx.wire import table
from phalanx.wire.fields import Row, copy, get_u16, get_u32, put_u16, put_u32
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from . import trusted
from .fleet import PENDING, START, Fleet
from .log import FLUSH_S, mark, read
from .rounds import again_after, drawn, flush_marks, hears_few, mixed, next_candidate, peer_at, withdraw

VERSION = table.REQUEST_VERSION
AT_FLAGS, AT_TEE, AT_T, AT_TOP_A, AT_TREQ_MAC = map(table.REQUEST.at, ("flags", "tee", "t", "top_a", "treq_mac"))
AT_TOP_S, AT_AUTH_S, AT_AUTH_A = map(table.REQUEST.at, ("top_s", "auth_s_mac", "auth_a_mac"))
AT_HCKPT, AT_TOKENS = map(table.REQUEST.at, ("hckpt", "tokens"))
AT_CHECKPOINT_LEN, AT_SEGMENT_LEN = map(table.REQUEST.at, ("start_length", "segment_length"))
HEAD_BYTES = table.REQUEST.size
TOKEN_TOR, TOKEN_T, TOKEN_MAC = map(table.COVERING_TOKEN.at, ("tor", "t", "mac"))
TOKEN_BYTES = table.COVERING_TOKEN.size

AUDIT = table.KIND_AUDIT
HELLO, FRAGMENT, TOKEN, SEEK = table.HELLO, table.FRAGMENT, table.TOKEN_REPLY, table.SEEK
AUDIT_HEAD_BYTES = table.AUDIT_HEADER_BYTES
FRAGMENT_HEAD_BYTES = table.AUDIT_FRAGMENT.size
TOKEN_FRAME_BYTES = table.AUDIT_TOKEN.size
AT_SRC, AT_DST, AT_SUB = map(table.AUDIT_HELLO.at, ("src", "dst", "sub"))
AT_REQUEST, AT_INDEX, AT_COUNT = map(table.AUDIT_FRAGMENT.at, ("request", "index", "count"))
REPLY_T, REPLY_MAC = map(table.AUDIT_TOKEN.at, ("t", "mac"))
AUTH_MAC = table.AUTHENTICATOR.at("mac")
TREQ_BYTES = table.TOKEN_REQUEST.size
# So often fragments of one request are said again that did not arrive.
REPEATS = 4
# Of f_max who fall silent amid a request each costs an eighth of a round on the mean: six and more are not waited for.
PATIENT = 5
# A HELLO is over by then, if it waited for a fragment or two of others.
LISTENS_MS = 5


@kernel
def is_audit(packet: Row, length: int) -> bool:
    """Return whether a packet is audit traffic, with its head."""
    return length >= AUDIT_HEAD_BYTES and int(packet[0]) & AUDIT != 0


@kernel
def is_fragment(packet: Row, length: int) -> bool:
    """Return whether a packet is a fragment of a request: its sender waits until it is sent."""
    return is_audit(packet, length) and packet[AT_SUB] == FRAGMENT


@kernel
def make_request(f: Fleet, i: int, now: int, treq: Row, auth_s: Row, auth_a: Row) -> int:
    """The request to the next candidate is in the robot's row of `f.request`; the three given are scratch memory.

    They have 32, 30 and 30 bytes.

    Returns: its length; 0 if there is nobody to ask, none is due or the log is full; negative: the a-node's error.
    Source: RoboRebound §3.7.
    """
    r = f.robot[i]
    if r.quota <= 0 or r.log_full == 1 or r.request_len > 0:
        return 0
    tor = next_candidate(f, i, now)
    if tor == 0:
        return 0
    code = flush_marks(f, i, treq, auth_s, auth_a, tor, now)
    if code < 0:
        r.quota = 0
        return code
    asked = f.peer[i, peer_at(f, i, tor)]
    asked.asked = r.round_no
    asked.asked_ms = now
    asked.claimed = r.checkpoint_no
    r.quota -= 1
    r.request_no = (int(r.request_no) + 1) & 0xFFFF
    r.request_to = tor
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
    put_u16(out, AT_TEE, int(r.id))
    copy(out, AT_T, treq, 0, TREQ_BYTES)  # they agree from t to the MAC
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
        put_u16(out, at + TOKEN_TOR, token.tor)
        put_u32(out, at + TOKEN_T, token.t)
        copy(out, at + TOKEN_MAC, token.mac, 0, MAC_BYTES)
        at += TOKEN_BYTES
    copy(out, at, f.checkpoint[i, START], 0, r.start_len)
    read(f, i, r.log_len, out, at + r.start_len)
    return int(length)


@kernel
def row_of(f: Fleet, i: int) -> int:
    """The row of `f.request` that the robot has, or has from now on, until it is withdrawn."""
    r = f.robot[i]
    if r.request_row == NO_ROW:
        r.request_row = lend(f.request)
    return int(r.request_row)


@kernel
def audit_head(frame: Row, src: int, dst: int, sub: int) -> None:
    """What every AUDIT frame begins with is written; `dst` 0 is all. Source: docs/spec/rebound.md."""
    frame[0] = AUDIT
    put_u16(frame, AT_SRC, src)
    put_u16(frame, AT_DST, dst)
    frame[AT_SUB] = sub


@kernel
def next_fragment(f: Fleet, i: int, now: int, frame: Row) -> int:
    """The next fragment of the request under way; its length, 0 when all have been cut or the next has to wait.

    Source: RoboRebound §3.7.
    """
    r = f.robot[i]
    body = f.settings[0].frame_max - FRAGMENT_HEAD_BYTES
    count = (r.request_len + body - 1) // body
    if r.request_len == 0 or r.request_next >= count:
        withdraw(f, i)
        return 0
    if now < r.repeat_at:
        return 0
    audit_head(frame, int(r.id), int(r.request_to), FRAGMENT)
    put_u16(frame, AT_REQUEST, int(r.request_no))
    frame[AT_INDEX] = r.request_next
    frame[AT_COUNT] = count
    begin = r.request_next * body
    length = min(body, r.request_len - begin)
    copy(frame, FRAGMENT_HEAD_BYTES, f.request.rows[r.request_row], begin, length)
    r.request_next += 1
    return int(FRAGMENT_HEAD_BYTES + length)


@kernel
def not_arrived(f: Fleet, i: int, now: int) -> None:
    """The fragment last said, which did not arrive, is said again after a while; after so many the next robot is asked.

    Who is out of the robot's hearing, and knows when it asks, could talk over each of its requests: so it waits a time
    that nobody knows who has not heard this request, out of a MAC in it, and each time about twice as long. A robot of
    which nothing arrived may be asked again at such a time too. The first f_max of those in a round are not waited for:
    else as many that are gone would cost others a round and more.
    Source: docs/adr/0028; RoboRebound §5.2.
    """
    r, s = f.robot[i], f.settings[0]
    if r.request_len == 0:
        return
    chance = mixed(drawn(f, i), r.repeats)
    nothing = r.request_next == 1
    given_up = nothing or s.f_max > PATIENT
    if r.repeats < REPEATS and not (given_up and _moves_on(f, i, now)):
        r.request_next = max(r.request_next - 1, 0)
        r.repeat_at = now + 1 + chance % max(1, s.t_audit >> (REPEATS + 2 - r.repeats))
        r.repeats += 1
        return
    if nothing:
        f.peer[i, peer_at(f, i, int(r.request_to))].asked_ms = now - again_after(f) + chance % (s.t_audit // 2)
    withdraw(f, i)
    r.quota += 1


@kernel
def _moves_on(f: Fleet, i: int, now: int) -> bool:
    """Whether a robot of which nothing arrived counts as gone: so may f_max in a round, while others can be asked.

    Not for who seeks: its a-node's requests are what is rare by then, and what is said again costs none.
    Source: docs/adr/0028, docs/adr/0036.
    """
    r, silent = f.robot[i], 0
    if r.seeks:
        return False
    for k in range(r.peers):
        silent += f.peer[i, k].asked == r.round_no and f.peer[i, k].answered != r.round_no
    tor = next_candidate(f, i, now)
    others = tor != 0 and f.peer[i, peer_at(f, i, tor)].asked != r.round_no
    return bool(others and silent <= f.settings[0].f_max)


@kernel
def listens(f: Fleet, i: int, now: int, auth_s: Row) -> int:
    """For how long the robot listens before it begins the round that is due, ms: 0 if the last one gave it its tokens.

    Two who speak at the same moment of each round would never hear each other's HELLO. Who lacks a token is silent at
    that moment, and speaks at another that differs from robot to robot. Who hears few besides will seek: then nobody
    can foresee the moment, which comes of an authenticator, in `auth_s` (30,), that is shown to nobody.
    Source: docs/adr/0030, docs/adr/0036.
    """
    r, s = f.robot[i], f.settings[0]
    r.seeks = 0
    if r.round_no == 0 or r.got > s.f_max:
        return 0
    chance = mixed(drawn(f, i), int(r.id))
    if hears_few(f, i, now) and trusted.snode_make_auth(s.profile, f.snode[i], f.hckpt[i, PENDING], auth_s) >= 0:
        mark(f, i, FLUSH_S)
        r.seeks = 1
        chance = r.secret = get_u32(auth_s, AUTH_MAC)
    return int(LISTENS_MS + chance % max(1, s.t_audit >> 4))


@kernel
def hello(f: Fleet, i: int, now: int, frame: Row) -> int:
    """The frame by which others know, in a round that begins, that this robot is here to audit; its length.

    Who seeks asks for one of each that hears it: they may have spoken when somebody talked over them. It asks for
    audits when they have answered. Source: docs/adr/0036.
    """
    r, s = f.robot[i], f.settings[0]
    if r.seeks:
        r.quota = 0
        r.asked_at = now
        pause = max(1, s.t_audit >> 3)
        r.seek_at = now + pause + mixed(int(r.secret), now) % pause
    audit_head(frame, int(r.id), 0, SEEK if r.seeks else HELLO)
    return AUDIT_HEAD_BYTES


@kernel
def seek(f: Fleet, i: int, now: int, frame: Row) -> int:
    """As `hello`, once more in a round that began so, after a pause that nobody can foresee; 0 if it is not to be."""
    r = f.robot[i]
    due = r.seeks != 0 and r.got <= f.settings[0].f_max and now >= r.seek_at
    return int(hello(f, i, now, frame)) if due and hears_few(f, i, now) else 0


@kernel
def hello_to(f: Fleet, i: int, src: int, now: int, frame: Row) -> int:
    """The same for one robot alone, which asked for it; 0 if it was told in the last T_audit / 2.

    Source: docs/adr/0036.
    """
    at = peer_at(f, i, src)
    if at < 0 or now - f.peer[i, at].told < f.settings[0].t_audit // 2:
        return 0
    f.peer[i, at].told = now
    audit_head(frame, int(f.robot[i].id), src, HELLO)
    return AUDIT_HEAD_BYTES


@kernel
def take_fragment(f: Fleet, i: int, frame: Row, length: int, now: int) -> int:
    """A fragment is put in its place.

    Returns: the place among `f.rx_info[i]` of a request that is now whole, or -1. Its row of `f.rx` is given back, and
        stays as it is until the next fragment comes.
    Source: docs/spec/rebound.md (bounded memory; one request under way a sender).
    """
    if length < FRAGMENT_HEAD_BYTES + 1:
        return -1
    src, no = get_u16(frame, AT_SRC), get_u16(frame, AT_REQUEST)
    index, count = int(frame[AT_INDEX]), int(frame[AT_COUNT])
    body = f.settings[0].frame_max - FRAGMENT_HEAD_BYTES
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
            x.row = lend(f.rx)
        x.src = src
        x.no = no
        x.count = count
        x.have = 0
        x.len = 0
    x.at = now
    x.have |= 1 << index
    copy(f.rx.rows[x.row], index * body, frame, FRAGMENT_HEAD_BYTES, size)
    if index == count - 1:
        x.len = index * body + size
    if x.have != (1 << count) - 1:
        return -1
    x.src = 0
    give_back(f.rx, x.row)
    return at


@kernel
def _place(f: Fleet, i: int, src: int) -> int:
    """The sender's, or a free one, or that of the request that has waited longest for its next fragment.

    Newcomers are never turned away: f_max liars who begin requests and do not end them would fill all places for ever.
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
    """One request of a robot each T_audit / 2, whether it is ever whole or not. Source: RoboRebound §5.1."""
    at = peer_at(f, i, src)
    if at < 0 or now - f.peer[i, at].took < f.settings[0].t_audit // 2:
        return False
    f.peer[i, at].took = now
    return True


@kernel
def admit(f: Fleet, i: int, src: int, t: int, now: int) -> bool:
    """Whether one more request is audited: what N_max neighbours may ask in T_val, and no token request twice.

    Each neighbour's share of that is its own: `take_fragment` begins one request of each in T_audit / 2.
    Source: RoboRebound §5.1, which has 6 f_max; docs/adr/0027.
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
