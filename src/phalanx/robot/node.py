"""One robot, wired: s-node → c-node → a-node. What an honest robot does at each event, as kernels.

The world calls `take` for a reading that is due, `think`, then `take` for each output; `hear` when a frame has
arrived; `next_frame` whenever its radio can take an AUDIT frame; the attacks in `robot.attacks` call the same.
Source: RoboRebound §3; docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

from phalanx.bti import audit, log, request, rounds, trusted
from phalanx.bti.audit import ACMD, INPUT, RECV, SEND
from phalanx.bti.fleet import PAPER, PLAIN, Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_LENGTH, ENTRY_T
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import Work
from phalanx.kernel import kernel, reads_peer
from phalanx.wire.fields import Row, copy, get_u16, get_u32, put_u16, put_u32
from phalanx.wire.table import MAC_BYTES, STATE

from . import auditor
from .controllers import dispatch

# What `hear` tells its caller; the numbers are in `work.told`.
NOTHING, REPLY, WHOLE, INSTALLED, HELLO = 0, 1, 2, 3, 4
TOLD_LENGTH, TOLD_TO, TOLD_REFUSAL, TOLD_TEE, TOLD_PLACE = 0, 1, 2, 3, 4
ID_AT = STATE.at("id")  # as in every other broadcast of a controller's
ID_BYTES = STATE.at("t") - ID_AT


@kernel
def boot(f: Fleet, i: int, now: int) -> None:
    """The c-node starts right after the mission key was loaded at `now`. Source: RoboRebound §3.3, §3.6."""
    r, s = f.robot[i], f.settings[0]
    r.alive = 1
    r.t_key = now
    r.phase = rounds.phase_of(s.mission_seed, int(r.id), s.t_control)
    r.step = 0
    r.state_len = dispatch.begin(s.controller, f.params, int(r.id), f.state[i])
    rounds.forget_checkpoint(f, i)


@kernel
def plain(w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """The entry as a trusted node would have made it, where there is none. Source: docs/spec/rebound.md."""
    if ENTRY_HEAD_BYTES + length > len(w.entry):
        return -1
    w.entry[0] = kind
    put_u32(w.entry, ENTRY_T, now)
    put_u16(w.entry, ENTRY_LENGTH, length)
    copy(w.entry, ENTRY_HEAD_BYTES, payload, 0, length)
    return int(ENTRY_HEAD_BYTES + length)


@kernel
def chain(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """The trusted node has chained a reading (INPUT), a frame (RECV, SEND) or a command (ACMD): its entry is `w.entry`.

    What is behind the entry's head may go on: to the c-node, the radio, the actuators.
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
    """The entry in `w.entry` is logged, where there are logs."""
    if f.settings[0].profile != PLAIN:
        log.append(f, i, w.entry, length)


@kernel
def take(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """As `chain`, and the entry is logged unless it is audit traffic."""
    n = chain(f, i, w, kind, now, payload, length)
    if n > 0 and (kind in (INPUT, ACMD) or not int(payload[0]) & request.AUDIT):
        record(f, i, w, n)
    return n


@kernel
@reads_peer(rejected=-1)
def advise(f: Fleet, i: int, advice: Row, length: int) -> int:
    """Give a planner's advice to the bundled controller. Returns: 0; -1: rejected. Source: docs/guard.md."""
    r, s = f.robot[i], f.settings[0]
    dispatch.on_advice(s.controller, f.params, int(r.id), advice, length, f.state[i])
    r.state_len = dispatch.size(s.controller, f.state[i])
    return 0


@kernel
def think(f: Fleet, i: int, w: Work, length: int) -> int:
    """The controller has seen the INPUT in `w.entry`; `w.out` has its outputs, of the length returned."""
    r, s = f.robot[i], f.settings[0]
    reading = w.entry[ENTRY_HEAD_BYTES:length]
    t = get_u32(w.entry, ENTRY_T)
    n = dispatch.on_input(
        s.controller, f.params, int(r.id), r.step, t, reading, length - ENTRY_HEAD_BYTES, f.state[i], w.out
    )
    r.step += 1
    r.state_len = dispatch.size(s.controller, f.state[i])
    return int(n)


@kernel
@reads_peer(rejected=-1)
def hear(f: Fleet, i: int, w: Work, now: int, frame: Row, length: int) -> int:
    """A frame has arrived: passed on by the a-node, logged and given to the controller, or taken as audit traffic.

    Returns: NOTHING; REPLY: an audit is over, `w.frame` is a token if `told[TOLD_REFUSAL]` is 0; INSTALLED: a token
        came; HELLO: it is in `w.frame`, for whom `told[TOLD_TO]` says; WHOLE: a request for a plain-Python controller
        waits at place `told[TOLD_PLACE]`. Negative: refused.
    Source: RoboRebound Alg. 4, §3.7.
    """
    s = f.settings[0]
    if s.profile == PLAIN and (length < 1 or int(frame[0]) & request.AUDIT):
        return NOTHING
    n = take(f, i, w, RECV, now, frame, length)
    if n < 0:
        return int(n)
    if not int(frame[0]) & request.AUDIT:
        if s.profile == PAPER and length >= ID_AT + ID_BYTES and frame[0] in dispatch.STATE_KINDS:
            # As printed: auditors are chosen among the neighbours that states claim.
            rounds.heard(f, i, get_u16(frame, ID_AT), now)
        if s.controller:
            r = f.robot[i]
            r.state_len = dispatch.on_recv(
                s.controller, f.params, int(r.id), get_u32(w.entry, ENTRY_T), frame, length, f.state[i]
            )
        return NOTHING
    return hear_audit(f, i, w, now, frame, length)


@kernel
def hear_audit(f: Fleet, i: int, w: Work, now: int, frame: Row, length: int) -> int:
    """An AUDIT frame: HELLO, SEEK, a fragment of a request, or a token. See `hear`. Source: docs/spec/rebound.md."""
    r = f.robot[i]
    if length < request.AUDIT_HEAD_BYTES:
        return NOTHING
    src, dst, sub = get_u16(frame, request.AT_SRC), get_u16(frame, request.AT_DST), int(frame[request.AT_SUB])
    if src == 0 or src == r.id or (dst != 0 and dst != r.id):
        return NOTHING
    rounds.heard(f, i, src, now)
    if sub == request.FRAGMENT:
        return hear_fragment(f, i, w, now, frame, length, src)
    if sub == request.TOKEN and length == request.TOKEN_FRAME_BYTES:
        t, mac = get_u32(frame, request.REPLY_T), frame[request.REPLY_MAC : request.TOKEN_FRAME_BYTES]
        if rounds.on_token(f, i, src, t, mac, now) == 0:
            w.told[TOLD_TEE] = src
            return INSTALLED
    if sub == request.SEEK and length == request.AUDIT_HEAD_BYTES:
        w.told[TOLD_LENGTH] = request.hello_to(f, i, src, now, w.frame)
        w.told[TOLD_TO] = src
        return HELLO if w.told[TOLD_LENGTH] else NOTHING
    return NOTHING


@kernel
def hear_fragment(f: Fleet, i: int, w: Work, now: int, frame: Row, length: int, src: int) -> int:
    """A fragment of a request by `src`, which is audited if it is whole now. See `hear`. Source: RoboRebound §3.7."""
    place = request.take_fragment(f, i, frame, length, now)
    if place < 0:
        return NOTHING
    w.told[TOLD_TEE] = src
    w.told[TOLD_PLACE] = place
    refused = knock(f, i, w, place, src)
    if refused == 0:
        if not request.admit(f, i, src, w.case[0].t, now):
            return NOTHING
        if f.settings[0].controller == 0:
            return WHOLE
        refused = judge(f, i, w, place, src)
    return answer(f, i, w, place, src, refused)


@kernel
def knock(f: Fleet, i: int, w: Work, place: int, src: int) -> int:
    """The request has a form and its token request is the sender's a-node's; the token waits in `w.small[2]`.

    Requests without a true token request must not count as audits: liars have any number of them, true ones are
    limited by their a-nodes. Nothing else can tell but IssueToken. What it made goes out if the replay agrees.
    Returns: 0 or a `Refusal`. Source: RoboRebound §3.8, §5.1.
    """
    q = f.rx.rows[f.rx_info[i, place].row]
    refused = audit.open_request(w, q, f.rx_info[i, place].len, src)
    if refused == 0:
        refused = audit.issue(f, i, w, q, w.small[2])
    return int(refused)


@kernel
@reads_peer(rejected=Refusal.DEFECT)
def judge(f: Fleet, i: int, w: Work, place: int, src: int) -> int:
    """The request at `place` is audited with a bundled controller.

    Returns: 0 or a `Refusal`. Source: RoboRebound §3.7.
    """
    info = f.rx_info[i, place]
    q, length = f.rx.rows[info.row], info.len
    refused = audit.examine(f, i, w, q, length, src)
    if refused == 0:
        refused = auditor.replay(f, w, q)
    return int(refused)


@kernel
def answer(f: Fleet, i: int, w: Work, place: int, src: int, refused: int) -> int:
    """The verdict is counted and, if it is good, the token frame is in `w.frame`. Returns: REPLY. See `hear`."""
    r = f.robot[i]
    w.told[TOLD_REFUSAL] = refused
    w.told[TOLD_TEE] = src
    w.told[TOLD_TO] = src
    if refused:
        r.audits_refused += 1
        w.told[TOLD_LENGTH] = 0
        return REPLY
    r.audits_passed += 1
    request.audit_head(w.frame, int(r.id), src, request.TOKEN)
    put_u16(w.frame, request.AT_REQUEST, f.rx_info[i, place].no)
    put_u32(w.frame, request.REPLY_T, w.case[0].t)
    copy(w.frame, request.REPLY_MAC, w.small[2], 0, MAC_BYTES)
    w.told[TOLD_LENGTH] = request.TOKEN_FRAME_BYTES
    return REPLY


@kernel
def next_frame(f: Fleet, i: int, w: Work, now: int) -> int:
    """The next fragment for the radio, of the request under way or of a new one, in `w.frame`.

    Returns: its length; 0 when there is nothing to send now. `told[TOLD_TO]` is whom to. Source: RoboRebound §3.7.
    """
    r = f.robot[i]
    n = request.next_fragment(f, i, now, w.frame)
    if n == 0 and request.make_request(f, i, now, w.small[0], w.small[1], w.small[2]) > 0:
        n = request.next_fragment(f, i, now, w.frame)
    w.told[TOLD_TO] = r.request_to
    return int(n)
