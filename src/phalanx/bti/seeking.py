"""Seeking: how a robot that lacks tokens finds auditors in range, and how other robots answer.

A robot seeks if an auditor stays silent in this round, if it lacks tokens and has no auditor left to ask, or if its
last round ended without enough tokens. It broadcasts SEEK at a random time, and repeats it until it has its tokens.
Each robot that receives SEEK answers once, at a random time. It sends the token that it issued in this round again,
in case that was lost, or else HERE with the nonce of SEEK. A seeking robot requests audits only from robots that have
just answered: each request uses up one of its a-node's few token requests.

All random times of a round are hashes of the MAC of an authenticator that is never sent. Attackers cannot predict
them, however many they have observed, so they cannot jam the packets selectively. A HELLO or HERE relayed from
elsewhere lacks the nonce and does not count.
Source: docs/adr/0039; docs/spec/rebound.md (rounds).
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire import table
from phalanx.wire.fields import Row, copy, get_u32, put_u16, put_u32, put_u64, whole
from phalanx.wire.record import record
from phalanx.wire.table import MAC_BYTES

from . import trusted
from .fleet import PAPER, PENDING, Fleet
from .log import FLUSH_S, mark
from .request import AUTH_MAC, audit_head, token_packet
from .rounds import is_waiting, mix_hash, next_candidate, peer_at, retry_interval_ms, withdraw

SEEK, HERE = table.SEEK, table.HERE
SEEK_BYTES, HERE_BYTES = table.AUDIT_SEEK.size, table.AUDIT_HERE.size
SEEK_NONCE, SEEK_SINCE, SEEK_SHARE = map(table.AUDIT_SEEK.at, ("nonce", "since", "share"))
HERE_NONCE = table.AUDIT_HERE.at("nonce")
# How often fragments of one request are repeated.
REPEATS = 4
# Largest f_max for which a robot waits for silent auditors: each wait takes an eighth of a round on average.
PATIENT = 5
# Long enough for a HELLO to arrive that had to wait for one or two fragments of other robots.
LISTENS_MS = 5
# Robots answer a SEEK within T_audit >> ANSWERS_IN. In half that time, compromised robots' packets, as far as their
# a-nodes' token buckets allow them, filled the channel (docs/adr/0039).
ANSWERS_IN = 3
# Until a robot answers, SEEK is repeated after T_audit >> UNANSWERED or a little more, in case all missed the last.
UNANSWERED = 5
# Limit of `robot.seeks`: after so many doublings of the share, all robots answer.
MOST_DOUBLED = 9
# Purposes of random numbers: nonce, how long to listen, when to seek, answer, repeat a fragment, ask a robot again.
NONCE, LISTEN, SEEK_AT, ANSWER, REPEAT, AGAIN = range(6)
DRAWN = record(
    "drawn: input of the hash that yields a random number", f"secret b{MAC_BYTES}", "purpose u8", "id u16", "t u64"
)
DRAWN_SECRET, DRAWN_PURPOSE, DRAWN_ID, DRAWN_T = map(DRAWN.at, ("secret", "purpose", "id", "t"))
DRAWN_BYTES = DRAWN.size


@kernel
def draw(f: Fleet, i: int, purpose: int, rob_id: int, now: int, scratch: Row) -> int:
    """Return a number below 2^32 that only this robot can predict: the hash of the record `drawn` with its secret.

    In `paper` there is no secret, and every robot can compute the number. `scratch` has at least 20 bytes.
    """
    copy(scratch, DRAWN_SECRET, f.robot[i].secret, 0, MAC_BYTES)
    scratch[DRAWN_PURPOSE] = purpose
    put_u16(scratch, DRAWN_ID, rob_id)
    put_u64(scratch, DRAWN_T, now)
    trusted.sha1(scratch, DRAWN_BYTES, scratch)
    return get_u32(scratch, 0)


@kernel
def listens(f: Fleet, i: int, now: int, auth_s: Row) -> int:
    """Return how many ms a robot that lacks tokens listens before its next round. It starts to seek in that round.

    Without the random delay, two robots whose rounds begin at the same moment would never receive each other's HELLO.
    `auth_s` (30,) is scratch.
    Source: docs/adr/0030.
    """
    r = f.robot[i]
    _start(f, i, now, int(r.round_no) + 1, auth_s)
    return int(LISTENS_MS + draw(f, i, LISTEN, int(r.id), now, auth_s) % max(1, f.settings[0].t_audit >> 4))


@kernel
def give_up_request(f: Fleet, i: int, now: int, auth_s: Row) -> None:
    """Withdraw the request whose fragment did not arrive, and seek; a robot that seeks repeats the fragment later.

    A hidden compromised robot that can predict requests could jam each of them. So fragments are repeated after random
    pauses, each about twice as long as the last. `auth_s` (30,) is scratch.
    Source: docs/adr/0028; RoboRebound §5.2.
    """
    r, s = f.robot[i], f.settings[0]
    if r.request_len == 0:
        return
    none_arrived = r.request_next == 1
    began = not r.seeks and _start(f, i, now, int(r.round_no), auth_s)
    if not (began or r.repeats == REPEATS or (s.f_max > PATIENT and _is_replaceable(f, i, now))):
        r.request_next = max(r.request_next - 1, 0)
        longest = max(1, s.t_audit >> (REPEATS + 2 - r.repeats))
        r.repeat_at = now + 1 + draw(f, i, REPEAT, int(r.id), now, auth_s) % longest
        r.repeats += 1
        return
    if none_arrived:  # the auditor has received no fragment, so it may be asked again in this round
        at = peer_at(f, i, int(r.request_to))
        pause = 0 if began else draw(f, i, AGAIN, int(r.id), now, auth_s) % (s.t_audit // 2)
        f.peer[i, at].asked_ms = now - retry_interval_ms(f) + pause
    withdraw(f, i)
    if not began:
        r.quota += 1


@kernel
def _is_replaceable(f: Fleet, i: int, now: int) -> bool:
    """Return whether a robot that was not asked yet has answered SEEK, and at most f_max auditors are silent."""
    r, silent = f.robot[i], 0
    for k in range(r.peers):
        silent += f.peer[i, k].asked == r.round_no and f.peer[i, k].answered != r.round_no
    other = next_candidate(f, i, now)
    return bool(other != 0 and silent <= f.settings[0].f_max and f.peer[i, peer_at(f, i, other)].asked != r.round_no)


@kernel
def seek(f: Fleet, i: int, now: int, auth_s: Row, packet: Row) -> int:
    """Write the next SEEK if it is due, and return its length; start to seek if an auditor is silent or none is left.

    `auth_s` (30,) is scratch.
    """
    r = f.robot[i]
    if not r.seeks:
        if r.request_len == 0 and _has_to_seek(f, i, now):
            _start(f, i, now, int(r.round_no), auth_s)
        return 0
    return int(write_seek(f, i, now, packet)) if now >= r.seek_at else 0


@kernel
def _has_to_seek(f: Fleet, i: int, now: int) -> bool:
    """Return whether, after the retry time, an auditor of this round is silent, or all were asked too recently.

    The latter occurs if all were asked late in the last round: then none is silent, and yet no token will arrive.
    """
    r, retry_ms = f.robot[i], f.settings[0].retry
    for k in range(r.peers):
        p = f.peer[i, k]
        if p.asked == r.round_no and p.answered != r.round_no and now >= p.asked_ms + retry_ms:
            return True
    began = r.round_no > 0 and now >= r.round_at + retry_ms
    return bool(began and is_waiting(f, i, now) and next_candidate(f, i, now) == 0)


@kernel
def _start(f: Fleet, i: int, now: int, number: int, auth_s: Row) -> bool:
    """Start to seek in round `number`; return False if that is impossible: `paper` has no SEEK."""
    r, s = f.robot[i], f.settings[0]
    if s.profile == PAPER or not _draw(f, i, number, auth_s):
        return False
    r.seeks = 1
    r.quota = 0
    r.asked_at = now
    r.seek_at = now + 1 + draw(f, i, SEEK_AT, int(r.id), now, auth_s) % max(1, s.t_audit >> 4)
    return True


@kernel
def _draw(f: Fleet, i: int, number: int, auth_s: Row) -> bool:
    """Draw the secret and the nonce of round `number`, unless already drawn; return False if the s-node refuses.

    A robot that listens before a round has already drawn them for that round.
    """
    r, s = f.robot[i], f.settings[0]
    if r.drawn_in > number:
        return True
    if trusted.snode_make_auth(s.profile, f.snode[i], f.hckpt[i, PENDING], auth_s) < 0:
        return False
    mark(f, i, FLUSH_S)
    r.drawn_in = number + 1
    copy(r.secret, 0, auth_s, AUTH_MAC, MAC_BYTES)
    r.nonce = draw(f, i, NONCE, int(r.id), number, auth_s)
    return True


@kernel
def write_seek(f: Fleet, i: int, now: int, packet: Row) -> int:
    """Write a SEEK, draw the time of the next one, and return its length.

    If many robots are in range, their answers would fill the channel. So the first SEEK of a round asks for about
    4 (f_max + 1) answers, and each further one for twice as many.
    """
    r, s = f.robot[i], f.settings[0]
    near, answered = 1, False
    for k in range(r.peers):
        p = f.peer[i, k]
        near += (now - p.heard) * 4 <= s.t_audit * 5
        answered = answered or p.here >= r.round_at
    share = ((s.f_max + 1) * 1024 // near) << (int(r.seeks) - 1)
    r.seeks = min(int(r.seeks) + 1, MOST_DOUBLED)
    r.quota = 0
    r.asked_at = now
    pause = max(1, s.t_audit >> (3 if answered else UNANSWERED))
    r.seek_at = now + pause + draw(f, i, SEEK_AT, int(r.id), now, packet) % pause
    audit_head(packet, int(r.id), 0, SEEK)
    put_u32(packet, SEEK_NONCE, whole(r.nonce))
    put_u32(packet, SEEK_SINCE, r.round_at)
    packet[SEEK_SHARE] = min(share, 255)
    return SEEK_BYTES


# --- robots that receive a SEEK ---


@kernel
def receive_seek(f: Fleet, i: int, src: int, now: int, packet: Row, auth_s: Row) -> int:
    """Store a SEEK by `src`; return when to answer it, ms of the robot's clock, or -1 for no answer.

    There is no answer if this robot has just answered one, or if it owes no token and is outside the share of robots
    that shall answer. `auth_s` (30,) is scratch.
    """
    r, s = f.robot[i], f.settings[0]
    at = peer_at(f, i, src)
    if at < 0 or not _draw(f, i, int(r.round_no), auth_s):
        return -1
    o, nonce, since = f.owed[i, at], get_u32(packet, SEEK_NONCE), get_u32(packet, SEEK_SINCE)
    owes = o.t > 0 and o.t >= since
    if (o.sought and now - o.sought < s.t_audit >> 3) or not (
        owes or mix_hash(nonce, int(r.id)) % 256 <= packet[SEEK_SHARE]
    ):
        return -1
    o.sought, o.nonce, o.since = now, nonce, since
    o.answer_at = now + 1 + draw(f, i, ANSWER, src, now, auth_s) % max(1, s.t_audit >> ANSWERS_IN)
    r.answer_at = o.answer_at if r.answer_at == 0 else min(r.answer_at, o.answer_at)
    return int(o.answer_at)


@kernel
def receive_here(f: Fleet, i: int, src: int, now: int, packet: Row) -> None:
    """Record that `src` is in range now, if its HERE repeats this robot's nonce of the round."""
    r = f.robot[i]
    at = peer_at(f, i, src)
    if at >= 0 and r.seeks and get_u32(packet, HERE_NONCE) == whole(r.nonce):
        f.peer[i, at].here = now


@kernel
def answer(f: Fleet, i: int, now: int, packet: Row) -> int:
    """Write the next answer to a SEEK that is due; return its length, 0 if none is due."""
    r = f.robot[i]
    if r.answer_at == 0 or now < r.answer_at:
        return 0
    due, later = -1, 0
    for k in range(r.peers):
        at = f.owed[i, k].answer_at
        if at == 0:
            continue
        if due < 0 and at <= now:
            due = k
        elif later == 0 or at < later:
            later = at
    r.answer_at = later
    if due < 0:
        return 0
    o, to = f.owed[i, due], whole(f.peer_id[i, due])
    o.answer_at = 0
    if o.t > 0 and o.t >= o.since:
        return int(token_packet(f, i, to, o.no, o.t, o.mac, packet))
    audit_head(packet, int(r.id), to, HERE)
    put_u32(packet, HERE_NONCE, o.nonce)
    return HERE_BYTES
