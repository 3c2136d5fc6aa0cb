"""Audit rounds on the auditee's side: choice of auditors, checkpoints, tokens, truncation of the log.

Source: RoboRebound §3.5-3.7; docs/spec/rebound.md.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.pool import NO_ROW, give_back
from phalanx.wire import table
from phalanx.wire.fields import Row, copy, put_u32, whole
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from . import trusted
from .fleet import LONG_AGO, OWED, PAPER, PEER, PENDING, START, Fleet, records
from .log import CHECKPOINT, FLUSH_A, FLUSH_S, mark, truncate

CHECKPOINT_BYTES = table.CHECKPOINT.size  # without the controller's state
AT_DUE, AT_STEP, AT_S_TOP, AT_A_TOP = map(table.CHECKPOINT.at, ("t", "step", "top_s", "top_a"))
BOOTED_BYTES = table.BOOTED.size
AT_T_KEY = table.BOOTED.at("t_key")
TREQ_TOP, TREQ_MAC = map(table.TOKEN_REQUEST.at, ("top", "mac"))

# Robots send a HELLO in each round: one that was silent for 2.5 rounds is taken to be out of range.
HEARD_ROUNDS_X2 = 5
MOST_MISSES = 15
# Entry of a robot that has just been added to the table of peers.
STRANGER = records(1, PEER)
STRANGER["heard"] = STRANGER["token"] = STRANGER["asked_ms"] = STRANGER["took"] = STRANGER["here"] = LONG_AGO
NOTHING_OWED = records(1, OWED)
STRANGER["asked"] = STRANGER["claimed"] = STRANGER["answered"] = STRANGER["took_t"] = -1


@kernel
def grid(f: Fleet, i: int, step: int) -> int:
    """Return when the robot's INPUT number `step` is due, ms of its own clock. Source: docs/spec/rebound.md."""
    r = f.robot[i]
    return int(r.t_key + r.phase + step * f.settings[0].t_control)


@kernel
def phase_of(mission_seed: int, rob_id: int, t_control: int) -> int:
    """Return where in the control period a robot's grid lies, 0..t_control-1 ms; every auditor can compute it.

    Source: docs/spec/rebound.md (phase(robId)); the mixing is splitmix's.
    """
    return int(mix_hash(mission_seed, rob_id) % t_control)


@kernel
def mix_hash(one: int, other: int) -> int:
    """Return a hash below 2^31 of two numbers. It is not cryptographic: every robot can compute it."""
    # When kernels run uncompiled, an id from an array is a uint16, which would overflow.
    x = (int(one) * 0x9E3779B1 + int(other) * 0x85EBCA77 + 0x165667B1) & 0xFFFFFFFF
    x = ((x ^ (x >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    x = ((x ^ (x >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return (x ^ (x >> 15)) & 0x7FFFFFFF


@kernel
def peer_at(f: Fleet, i: int, rob_id: int) -> int:
    """Return the row of a robot in the table of peers, adding it if new; -1 for id 0 and the robot itself.

    If the table is full, a new robot replaces another.

    Source: docs/spec/rebound.md (constant memory).
    """
    r = f.robot[i]
    for k in range(r.peers):
        if f.peer_id[i, k] == rob_id:
            return k
    if rob_id == 0 or rob_id == r.id:
        return -1
    at = r.peers
    if at < f.peer.shape[1]:
        r.peers += 1
    else:
        at = _replaceable(f, i)
    f.peer[i, at] = STRANGER[0]
    f.owed[i, at] = NOTHING_OWED[0]
    f.peer_id[i, at] = rob_id
    return int(at)


@kernel
def _replaceable(f: Fleet, i: int) -> int:
    """Return the row of the peer to replace: the one silent for longest, preferably one that took no part in audits.

    Compromised robots could relay the HELLO of so many distant robots that these replace all real neighbours. So peers
    that gave a token, answered a SEEK or requested an audit within T_val are replaced last. In `paper` all are equal.
    """
    r, s = f.robot[i], f.settings[0]
    oldest, at = 1 << 60, 0
    for k in range(r.peers):
        p = f.peer[i, k]
        known = s.profile != PAPER and max(p.token, p.here, p.took) >= r.round_at - s.t_val
        last = p.heard + ((1 << 50) if known else 0)
        if last < oldest:
            oldest, at = last, k
    return at


@kernel
def mark_in_range(f: Fleet, i: int, rob_id: int, now: int) -> None:
    """Record that a robot is in range now. Source: docs/spec/rebound.md (ghost auditors)."""
    at = peer_at(f, i, rob_id)
    if at >= 0:
        f.peer[i, at].heard = now


@kernel
def next_candidate(f: Fleet, i: int, now: int) -> int:
    """Return the id of the auditor to ask next in this round, or 0 if none is left.

    Robots that issued a token recently come first, then others that sent AUDIT packets. A seeking robot asks only
    robots that have just answered its SEEK and does not prefer earlier issuers: compromised ones would use up its few
    requests. Within each group, robots that did not answer the last requests come later. The order of the rest
    differs from robot to robot, which spreads the load over the auditors.
    Source: docs/spec/rebound.md (ghost auditors); docs/adr/0036.
    """
    r, s = f.robot[i], f.settings[0]
    best, best_key = 0, 1 << 40
    for k in range(r.peers):
        p, rob_id = f.peer[i, k], whole(f.peer_id[i, k])
        if p.answered == r.round_no or now < p.asked_ms + retry_interval_ms(f):
            continue
        fresh = p.token >= now - s.t_val
        if r.seeks:
            fresh = True
            if now - p.here > s.t_audit // 2:
                continue
        elif not fresh and p.heard * 2 < now * 2 - HEARD_ROUNDS_X2 * s.t_audit:
            continue
        key = mix_hash(int(r.id), rob_id) + (whole(p.misses) << 32) + (0 if fresh else 1 << 36)
        if p.asked == r.round_no:
            key += 1 << 37  # silent so far in this round: only if no other is left
        if key < best_key:
            best, best_key = rob_id, key
    return int(best)


@kernel
def retry_interval_ms(f: Fleet) -> int:
    """Return the ms until the same auditor may be asked again: it accepts one request per T_audit / 2.

    Waiting for the next round would cost a robot with just f_max + 1 auditors in range a whole round per lost
    fragment. Asking sooner would fail, and then fail in each following round too (this was observed).
    Source: RoboRebound §5.1, §5.2.
    """
    return int(f.settings[0].t_audit // 2 + f.settings[0].retry)


@kernel
def is_waiting(f: Fleet, i: int, now: int) -> bool:
    """Return whether a peer without an answer in this round was asked too recently to be asked again now."""
    r, pause_ms = f.robot[i], retry_interval_ms(f)
    for k in range(r.peers):
        p = f.peer[i, k]
        if p.answered != r.round_no and now < p.asked_ms + pause_ms:
            return True
    return False


@kernel
def next_retry(f: Fleet, i: int, now: int) -> int:
    """Return when to send the next request, ms of the robot's clock; -1 if the robot has all its tokens.

    Source: RoboRebound §5.2.
    """
    r, s = f.robot[i], f.settings[0]
    if r.got > s.f_max:
        return -1
    soon = r.asked_at + s.retry
    if r.request_len > 0:
        r.retry_at = r.repeat_at
    elif soon > now:
        r.retry_at = soon
    elif r.seeks or (s.profile != PAPER and is_waiting(f, i, now)):
        # An answer may come at any time, and an a-node without token requests soon grants another. A robot that does
        # not seek yet polls as often: compromised robots could silence it for half a round by delaying a fragment.
        r.retry_at = now + s.retry
    else:
        r.retry_at = max(now + s.retry, r.asked_at + retry_interval_ms(f))
    if r.seeks and r.request_len == 0:
        r.retry_at = min(r.retry_at, r.seek_at)
    r.retry_at = max(r.retry_at, now + 1)
    return int(r.retry_at)


@kernel
def end_round(f: Fleet, i: int) -> bool:
    """Stop seeking; return whether the round ends without enough tokens."""
    r = f.robot[i]
    r.seeks = 0
    return bool(r.round_no > 0 and r.got <= f.settings[0].f_max)


@kernel
def begin_round(f: Fleet, i: int, now: int) -> None:
    """Start a new round, with a quota of one request per token that is needed. Source: RoboRebound §3.7."""
    r = f.robot[i]
    for k in range(r.peers):
        p = f.peer[i, k]
        if p.asked == r.round_no and p.answered != r.round_no:
            p.misses = min(int(p.misses) + 1, MOST_MISSES)
    r.round_no += 1
    r.round_at = now
    r.quota = f.settings[0].f_max + 1
    r.got = 0
    withdraw(f, i)


@kernel
def withdraw(f: Fleet, i: int) -> None:
    """Withdraw the request that is being sent, if there is one."""
    r = f.robot[i]
    r.request_len = 0
    if r.request_row != NO_ROW:
        give_back(f.request, int(r.request_row))
        r.request_row = NO_ROW


@kernel
def retry(f: Fleet, i: int, now: int) -> int:
    """Return how many tokens are missing in this round if more requests are due, else 0.

    Before the first round, which sends the first HELLO, none is due: robots that answer a SEEK would use up requests.
    Source: RoboRebound §5.2.
    """
    r = f.robot[i]
    if r.round_no == 0 or now < r.retry_at:
        return 0
    missing = max(f.settings[0].f_max + 1 - r.got, 0)
    if r.request_len == 0:
        r.quota = missing
    return int(missing)


@kernel
def write_checkpoint(f: Fleet, i: int, s_top: Row, a_top: Row) -> None:
    """Make the current state the pending checkpoint, right after both chains were flushed with no output pending.

    Source: RoboRebound §3.6, §5.2 (66 + 26 n bytes).
    """
    r = f.robot[i]
    c = f.checkpoint[i, PENDING]
    put_u32(c, AT_DUE, grid(f, i, r.step))
    put_u32(c, AT_STEP, r.step)
    copy(c, AT_S_TOP, s_top, 0, HASH_BYTES)
    copy(c, AT_A_TOP, a_top, 0, HASH_BYTES)
    copy(c, CHECKPOINT_BYTES, f.state[i], 0, r.state_len)
    r.pending_len = CHECKPOINT_BYTES + r.state_len
    trusted.sha1(c, r.pending_len, f.hckpt[i, PENDING])
    r.tokens_pending = 0
    r.checkpoint_no += 1
    r.checkpoint_at = r.log_len
    mark(f, i, CHECKPOINT)


@kernel
def forget_checkpoint(f: Fleet, i: int) -> None:
    """Start the log at boot, with zero tops and no tokens. Source: RoboRebound §3.6 (a)."""
    r = f.robot[i]
    put_u32(f.checkpoint[i, START], AT_T_KEY, r.t_key)
    r.start_len = BOOTED_BYTES
    r.booted = 1
    r.tokens_start = 0
    r.tokens_pending = 0
    r.checkpoint_at = -1
    r.log_len = 0
    r.checkpoint_no = 0
    r.start_no = 0


@kernel
def on_token(f: Fleet, i: int, auditor: int, t: int, mac: Row, now: int) -> int:
    """Install a token and store it; once f_max + 1 cover the pending checkpoint, truncate the log there.

    A token counts as an answer of this round only if it matches the request to its auditor in time and checkpoint.
    Otherwise a compromised robot could keep this one from asking others: it would send old tokens again, or sign the
    start of the log. Both stopped correct robots in tests.
    Returns: 0, or negative if the token covers none of our checkpoints. Source: RoboRebound §3.5, §3.6.
    """
    r, s = f.robot[i], f.settings[0]
    which, code = PENDING, trusted.E_BAD_MAC
    if r.checkpoint_at >= 0:
        code = _install(f, i, PENDING, auditor, t, mac, now)
    if code == trusted.E_BAD_MAC and r.booted == 0:  # not for the pending checkpoint: try the start checkpoint
        which, code = START, _install(f, i, START, auditor, t, mac, now)
    if code < 0:
        return code
    r.tokens_got += 1
    at = peer_at(f, i, auditor)
    if at >= 0:
        p = f.peer[i, at]
        number = r.start_no if which == START else r.checkpoint_no
        asked_for_it = p.asked == r.round_no and t >= p.asked_ms and p.claimed == number
        if asked_for_it and p.answered != r.round_no:
            r.got += 1
            p.answered = r.round_no
            p.misses = 0
        p.token = max(p.token, t)
    _keep(f, i, which, auditor, t, mac)
    if which == PENDING and r.tokens_pending >= s.f_max + 1:
        _promote(f, i)
    return 0


@kernel
def _install(f: Fleet, i: int, which: int, auditor: int, t: int, mac: Row, now: int) -> int:
    return int(trusted.anode_install_token(f.settings[0].profile, f.anode[i], now, auditor, t, f.hckpt[i, which], mac))


@kernel
def _keep(f: Fleet, i: int, which: int, auditor: int, t: int, mac: Row) -> None:
    """Store a token for a checkpoint, one per auditor."""
    r = f.robot[i]
    n = r.tokens_start if which == START else r.tokens_pending
    at = n
    for k in range(n):
        if f.token[i, which, k].auditor == auditor:
            at = k
    if at >= f.token.shape[2]:
        return
    f.token[i, which, at].auditor = auditor
    f.token[i, which, at].t = t
    copy(f.token[i, which, at].mac, 0, mac, 0, MAC_BYTES)
    if at == n:
        if which == START:
            r.tokens_start = n + 1
        else:
            r.tokens_pending = n + 1


@kernel
def _promote(f: Fleet, i: int) -> None:
    r = f.robot[i]
    truncate(f, i)
    copy(f.checkpoint[i, START], 0, f.checkpoint[i, PENDING], 0, r.pending_len)
    copy(f.hckpt[i, START], 0, f.hckpt[i, PENDING], 0, HASH_BYTES)
    r.start_len = r.pending_len
    r.start_no = r.checkpoint_no
    r.booted = 0
    for k in range(r.tokens_pending):
        f.token[i, START, k] = f.token[i, PENDING, k]
    r.tokens_start = r.tokens_pending
    r.tokens_pending = 0


@kernel
def flush_marks(f: Fleet, i: int, treq: Row, auth_s: Row, auth_a: Row, auditor: int, now: int) -> int:
    """Make a token request and its authenticators; flush both chains for them, and mark the flushes in the log.

    `treq` (32,) gets a `token_request`; `auth_s` and, in profile `paper` only, `auth_a` (30,) get an `authenticator`
    (phalanx.wire.table).
    Returns: 0, or the a-node's error: the leaky bucket is empty, or there is no key.
    Source: RoboRebound Alg. 2, Alg. 4; docs/spec/rebound.md (stale log).
    """
    r, s = f.robot[i], f.settings[0]
    code = trusted.anode_token_request(s.profile, f.anode[i], now, auditor, treq)
    if code < 0:
        return int(code)
    if s.profile == PAPER:
        code = trusted.anode_make_auth(s.profile, f.anode[i], auth_a)
        if code < 0:
            return int(code)
        copy(treq, TREQ_TOP, auth_a, 0, HASH_BYTES)
    mark(f, i, FLUSH_A)
    code = trusted.snode_make_auth(s.profile, f.snode[i], treq[TREQ_MAC : TREQ_MAC + MAC_BYTES], auth_s)
    if code < 0:
        return int(code)
    mark(f, i, FLUSH_S)
    if r.checkpoint_at < 0:
        write_checkpoint(f, i, auth_s, treq[TREQ_TOP : TREQ_TOP + HASH_BYTES])
    return 0
