"""One robot: events in, actions out. s-node → c-node → a-node, as kernels over one row of a fleet.

The surroundings call a handler for each event, and carry out the actions in `work.actions` (actions.py) in order:

    on_boot      the mission key was loaded        on_round   T_audit has passed, or the robot has listened
    on_reading   the sensors were read             on_retry   the time of a `RETRY_AT` has come
    on_advice    a planner has advised             on_sent    the radio has sent a fragment, or given it up
    on_packet    a packet has arrived

The protocol in short (RoboRebound §3; docs/spec/rebound.md):

Log. Each reading passes the s-node, and each packet and command the a-node. The node chains it by a hash, and the
c-node logs the same bytes. Auditors replay the log with the mission's controller, and compare.

Rounds. A robot needs fresh tokens of f_max + 1 auditors, or its a-node stops it. So each T_audit a round begins: the
robot sends HELLO, so that others know an auditor; takes a checkpoint with its first request; and asks one robot after
the other for a token. A request goes out in fragments, one whenever the radio has sent the last.

Tokens. An auditor whose replay agrees returns a token for the checkpoint that the request claims. With f_max + 1 of
them the robot drops its log up to that checkpoint.

Seeking. If an auditor stays silent, or a round ends without enough tokens, the robot sends SEEK at a random time. Each
robot that receives it answers at a random time, and the robot asks only those (bti/seeking.py).

A robot whose controller is plain Python runs the same kernels step by step (robot.py). So does an attack, in another
order or with other bytes (adversary/liar.py).
"""

from __future__ import annotations

from phalanx.bti import audit, log, request, rounds, seeking, trusted
from phalanx.bti.audit import ACMD, INPUT, RECV, SEND
from phalanx.bti.fleet import PAPER, PLAIN, Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_LENGTH, ENTRY_T
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import Work
from phalanx.kernel import kernel, reads_peer
from phalanx.wire.fields import OUTPUT_HEAD_BYTES, OUTPUT_LENGTH, Row, copy, get_u16, get_u32, put_u16, put_u32
from phalanx.wire.table import MAC_BYTES, STATE

from . import actions
from .controllers import dispatch
from .replay import replay_bundled

# What `on_packet` returns beside its actions.
NOTHING, HEARD, WHOLE = 0, 1, 2
ID_AT = STATE.at("id")  # as in every other broadcast of a controller's
ID_BYTES = STATE.at("t") - ID_AT


@kernel
def on_boot(f: Fleet, i: int, now: int) -> None:
    """Start the c-node, right after the mission key was loaded at `now`. Source: RoboRebound §3.3, §3.6."""
    r, s = f.robot[i], f.settings[0]
    r.alive = 1
    r.t_key = now
    r.phase = rounds.phase_of(s.mission_seed, int(r.id), s.t_control)
    r.step = 0
    r.state_len = dispatch.begin(s.controller, f.params, int(r.id), f.state[i])
    rounds.forget_checkpoint(f, i)


@kernel
@reads_peer(rejected=-1)
def on_advice(f: Fleet, i: int, advice: Row, length: int) -> int:
    """Give a planner's advice to the bundled controller. Returns: 0; -1: rejected. Source: docs/guides/guard.md."""
    r, s = f.robot[i], f.settings[0]
    dispatch.on_advice(s.controller, f.params, int(r.id), advice, length, f.state[i])
    r.state_len = dispatch.size(s.controller, f.state[i])
    return 0


@kernel
def on_reading(f: Fleet, i: int, w: Work, now: int, reading: Row, length: int) -> None:
    """Handle a reading: the s-node chains it, the controller decides, and its outputs go out.

    Source: RoboRebound Alg. 1.
    """
    actions.clear(w)
    n = take(f, i, w, INPUT, now, reading, length)
    if n > 0:
        send_output(f, i, w, now, run_controller(f, i, w, n))


@kernel
def send_output(f: Fleet, i: int, w: Work, now: int, length: int) -> None:
    """Pass the packets and commands in `w.out[:length]` through the a-node, and on as actions."""
    at = 0
    while at < length:
        kind, size = int(w.out[at]), get_u16(w.out, at + OUTPUT_LENGTH)
        at += OUTPUT_HEAD_BYTES
        if kind == ACMD:
            act(f, i, w, now, w.out[at : at + size], size)
        else:
            send(f, i, w, now, w.out[at : at + size], size, actions.EVERYBODY)
        at += size


@kernel
def act(f: Fleet, i: int, w: Work, now: int, command: Row, length: int) -> int:
    """Pass a command through the a-node to the actuators, and log it. Returns: as `chain`."""
    n = take(f, i, w, ACMD, now, command, length)
    if n > 0:
        actions.carry(w, actions.ACTUATE, 0, command, 0, length)
    return n


@kernel
def send(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int, to: int) -> int:
    """Pass a packet through the a-node to the radio, and log it unless it is audit traffic. Returns: as `chain`."""
    n = take(f, i, w, SEND, now, packet, length)
    if n > 0:
        actions.carry(w, actions.TRANSMIT, to, w.entry, ENTRY_HEAD_BYTES, n - ENTRY_HEAD_BYTES)
    return n


@kernel
def run_controller(f: Fleet, i: int, w: Work, length: int) -> int:
    """Run the controller on the INPUT in `w.entry`; write its outputs to `w.out`, and return their length."""
    r, s = f.robot[i], f.settings[0]
    reading = w.entry[ENTRY_HEAD_BYTES:length]
    t = get_u32(w.entry, ENTRY_T)
    n = dispatch.on_input(
        s.controller, f.params, int(r.id), r.step, t, reading, length - ENTRY_HEAD_BYTES, f.state[i], w.out
    )
    r.step += 1
    r.state_len = dispatch.size(s.controller, f.state[i])
    return int(n)


# --- what passes the trusted nodes: they chain it, and the c-node logs the same bytes. Source: RoboRebound §3.4 ---


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
def take(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Chain as `chain` does, and log the entry unless it is audit traffic."""
    n = chain(f, i, w, kind, now, payload, length)
    if n > 0 and f.settings[0].profile != PLAIN and (kind in (INPUT, ACMD) or not int(payload[0]) & request.AUDIT):
        log.append(f, i, w.entry, n)
    return n


# --- auditor ---


@kernel
def on_packet(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int) -> int:
    """Handle a packet that the radio received: the controller gets it, or it is audit traffic and is handled here.

    Returns: NOTHING; HEARD: it is logged, and for the controller; WHOLE: it completed a request, at `work.place[0]`,
        that a controller in plain Python has to replay. Negative: the a-node refused the packet.
    Source: RoboRebound Alg. 4, §3.7.
    """
    actions.clear(w)
    heard = hear(f, i, w, now, packet, length)
    if heard < 0:
        actions.clear(w)
    return heard


@kernel
@reads_peer(rejected=-1)
def hear(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int) -> int:
    """Handle a packet; see `on_packet`."""
    s = f.settings[0]
    if s.profile == PLAIN and (length < 1 or int(packet[0]) & request.AUDIT):
        return NOTHING
    n = take(f, i, w, RECV, now, packet, length)
    if n < 0:
        return int(n)
    if int(packet[0]) & request.AUDIT:
        return handle_audit(f, i, w, now, packet, length)
    if s.profile == PAPER and length >= ID_AT + ID_BYTES and packet[0] in dispatch.STATE_KINDS:
        # As printed: auditors are chosen among the neighbours that states claim.
        rounds.heard(f, i, get_u16(packet, ID_AT), now)
    if s.controller:
        r, t = f.robot[i], get_u32(w.entry, ENTRY_T)
        r.state_len = dispatch.on_recv(s.controller, f.params, int(r.id), t, packet, length, f.state[i])
    return HEARD


@kernel
def handle_audit(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int) -> int:
    """Handle an AUDIT packet: HELLO, SEEK, a fragment of a request, or a token. Source: docs/spec/rebound.md."""
    r = f.robot[i]
    if length < request.AUDIT_HEAD_BYTES:
        return NOTHING
    src, dst, sub = get_u16(packet, request.AT_SRC), get_u16(packet, request.AT_DST), int(packet[request.AT_SUB])
    if src == 0 or src == r.id or (dst != 0 and dst != r.id):
        return NOTHING
    rounds.heard(f, i, src, now)
    if sub == request.FRAGMENT:
        return store_fragment(f, i, w, now, packet, length, src)
    if sub == request.TOKEN and length == request.TOKEN_FRAME_BYTES:
        t, mac = get_u32(packet, request.REPLY_T), packet[request.REPLY_MAC : request.TOKEN_FRAME_BYTES]
        rounds.on_token(f, i, src, t, mac, now)
    elif sub == seeking.SEEK and length == seeking.SEEK_BYTES:
        answer_at = seeking.receive_seek(f, i, src, now, packet, w.small[1])
        if answer_at > 0:
            actions.append(w, actions.RETRY_AT, answer_at, 0)
    elif sub == seeking.HERE and length == seeking.HERE_BYTES:
        seeking.receive_here(f, i, src, now, packet)
    return NOTHING


@kernel
def store_fragment(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int, src: int) -> int:
    """Store a fragment of a request by `src`, and audit the request if it is complete. Source: RoboRebound §3.7."""
    place = request.take_fragment(f, i, packet, length, now)
    if place < 0:
        return NOTHING
    w.place[0] = place
    refused = precheck_request(f, i, w, place, src)
    if refused == 0:
        if not request.admit(f, i, src, w.case[0].t, now):
            return NOTHING
        if f.settings[0].controller == 0:
            return WHOLE
        refused = audit_request(f, i, w, place, src)
    answer(f, i, w, now, place, src, refused)
    return NOTHING


@kernel
def precheck_request(f: Fleet, i: int, w: Work, place: int, src: int) -> int:
    """Check the request's form, and have the a-node issue the token to `w.small[2]`: `answer` sends it after the audit.

    Compromised robots can make any number of false token requests, which must not count as audits. Only IssueToken
    detects them.
    Returns: 0 or a `Refusal`. Source: RoboRebound §3.8, §5.1.
    """
    q = f.rx.rows[f.rx_info[i, place].row]
    refused = audit.open_request(w, q, f.rx_info[i, place].len, src)
    if refused == 0:
        refused = audit.issue(f, i, w, q, w.small[2])
    return int(refused)


@kernel
@reads_peer(rejected=Refusal.DEFECT)
def audit_request(f: Fleet, i: int, w: Work, place: int, src: int) -> int:
    """Audit the request at `place` with the bundled controller; return 0 or a `Refusal`. Source: RoboRebound §3.7."""
    info = f.rx_info[i, place]
    q, length = f.rx.rows[info.row], info.len
    refused = audit.examine(f, i, w, q, length, src)
    if refused == 0:
        refused = replay_bundled(f, w, q)
    return int(refused)


@kernel
def answer(f: Fleet, i: int, w: Work, now: int, place: int, src: int, refused: int) -> None:
    """Count the verdict on the request at `place`, and send the token unless the audit refused it."""
    r = f.robot[i]
    actions.append(w, actions.VERDICT, src, refused)
    if refused:
        r.audits_refused += 1
        return
    r.audits_passed += 1
    number = int(f.rx_info[i, place].no)
    n = request.new_token(f, i, src, number, int(w.case[0].t), w.small[2, :MAC_BYTES], w.packet)
    send(f, i, w, now, w.packet, n, src)


# --- audited ---


@kernel
def on_round(f: Fleet, i: int, w: Work, now: int, listened: int, busy: int) -> None:
    """Begin a round: say HELLO, take a checkpoint, ask the first auditor. Source: RoboRebound §3.7.

    Args:
        listened: 1 when the robot has been silent before this round, as the last `ROUND_AT` said.
        busy: 1 while the radio holds a fragment.
    """
    actions.clear(w)
    if listened or not listen(f, i, w, now):
        begin_round(f, i, w, now)
        ask(f, i, w, now, busy)


@kernel
def listen(f: Fleet, i: int, w: Work, now: int) -> bool:
    """Ask for the next round, and return whether this one waits until the robot has listened (seeking.listens)."""
    actions.append(w, actions.ROUND_AT, now + f.settings[0].t_audit, 0)
    wait_ms = seeking.listens(f, i, now, w.small[1]) if rounds.end_round(f, i) else 0
    if wait_ms > 0:
        actions.append(w, actions.ROUND_AT, now + wait_ms, 1)
    return wait_ms > 0


@kernel
def begin_round(f: Fleet, i: int, w: Work, now: int) -> None:
    """Open a round, and send HELLO or SEEK."""
    rounds.begin_round(f, i, now)
    n = seeking.write_seek(f, i, now, w.packet) if f.robot[i].seeks else request.hello(f, i, w.packet)
    send(f, i, w, now, w.packet, n, actions.EVERYBODY)


@kernel
def on_retry(f: Fleet, i: int, w: Work, now: int, busy: int) -> None:
    """Ask further robots if tokens are missing at the retry time. Source: RoboRebound §5.2."""
    actions.clear(w)
    if seek(f, i, w, now):
        ask(f, i, w, now, busy)


@kernel
def seek(f: Fleet, i: int, w: Work, now: int) -> bool:
    """Answer SEEKs, and send one, if that is due; return whether it is time to ask for missing tokens."""
    n = seeking.answer(f, i, now, w.packet)
    while n > 0:
        send(f, i, w, now, w.packet, n, get_u16(w.packet, request.AT_DST))
        n = seeking.answer(f, i, now, w.packet)
    for at_ms in (f.robot[i].answer_at, f.robot[i].retry_at):
        if at_ms > now:
            actions.append(w, actions.RETRY_AT, int(at_ms), 0)
    if rounds.retry(f, i, now) == 0:
        return False
    n = seeking.seek(f, i, now, w.small[1], w.packet)
    if n > 0:
        send(f, i, w, now, w.packet, n, actions.EVERYBODY)
    return True


@kernel
def on_sent(f: Fleet, i: int, w: Work, now: int, arrived: int, busy: int) -> None:
    """Send the next fragment: the radio has sent the last one, or given it up. Source: RoboRebound §5.2."""
    actions.clear(w)
    if arrived == 0:
        seeking.give_up_request(f, i, now, w.small[1])
    ask(f, i, w, now, busy)


@kernel
def ask(f: Fleet, i: int, w: Work, now: int, busy: int) -> None:
    """Send the next fragment, or say when to retry; while the radio holds one, wait for `on_sent`."""
    if busy == 0:
        ask_with(f, i, w, now, next_fragment(f, i, w, now))


@kernel
def next_fragment(f: Fleet, i: int, w: Work, now: int) -> int:
    """Write the next fragment, of a new request if need be, to `w.packet`; return its length, 0 for nothing to send."""
    n = request.next_fragment(f, i, now, w.packet)
    if n == 0 and request.make_request(f, i, now, w.small[0], w.small[1], w.small[2]) > 0:
        n = request.next_fragment(f, i, now, w.packet)
    return int(n)


@kernel
def ask_with(f: Fleet, i: int, w: Work, now: int, length: int) -> None:
    """Send the fragment in `w.packet`; without one, say when to retry. Source: RoboRebound §5.2."""
    if length > 0:
        if send(f, i, w, now, w.packet, length, int(f.robot[i].request_to)) <= 0:
            actions.append(w, actions.RETRY_AT, request.postpone(f, i, now), 0)
        return
    at_ms = rounds.next_retry(f, i, now)
    if at_ms >= 0:
        actions.append(w, actions.RETRY_AT, at_ms, 0)
