"""Event handlers of one robot: events in, actions out, as kernels over one row of a fleet.

The caller runs a handler for each event, and then carries out the actions in `work.actions` (actions.py) in order:

    on_boot      the mission key was loaded        on_round   T_audit has passed, or the robot has listened
    on_reading   the sensors were read             on_retry   the time of a `RETRY_AT` has come
    on_advice    a planner has sent advice         on_sent    the radio has sent a fragment, or dropped it
    on_packet    a packet has arrived

The protocol in short (RoboRebound §3; docs/spec/rebound.md):

Log. Each reading passes through the s-node, and each packet and command through the a-node. The node adds it to a hash
chain, and the c-node logs the same bytes. Auditors replay the log with the mission's controller, and compare.

Rounds. A robot needs fresh tokens from f_max + 1 auditors, or its a-node stops it. So each T_audit a round begins. The
robot sends HELLO, which announces it as an auditor. It takes a checkpoint with its first request, and asks one robot
after the other for a token. It sends a request in fragments, each after the radio has sent the last one.

Tokens. An auditor whose replay agrees returns a token for the checkpoint that the request claims. With f_max + 1
tokens the robot drops its log up to that checkpoint.

Seeking. If an auditor stays silent, or a round ends without enough tokens, the robot sends SEEK at a random time. Each
robot that receives it answers at a random time, and the robot requests audits only from those (bti/seeking.py).

A robot with a controller in plain Python runs the same kernels step by step (robot.py). Attacks run them in another
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

# Results of `on_packet`.
NOTHING, HEARD, WHOLE = 0, 1, 2
ID_AT = STATE.at("id")  # the same in all broadcasts of controllers
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
    """Pass a planner's advice to the bundled controller. Returns: 0; -1: rejected. Source: docs/guides/guard.md."""
    r, s = f.robot[i], f.settings[0]
    dispatch.on_advice(s.controller, f.params, int(r.id), advice, length, f.state[i])
    r.state_len = dispatch.size(s.controller, f.state[i])
    return 0


@kernel
def on_reading(f: Fleet, i: int, w: Work, now: int, reading: Row, length: int) -> None:
    """Handle a reading: the s-node chains it, the controller runs, and its outputs are sent.

    Source: RoboRebound Alg. 1.
    """
    actions.clear(w)
    n = take(f, i, w, INPUT, now, reading, length)
    if n > 0:
        send_output(f, i, w, now, run_controller(f, i, w, n))


@kernel
def send_output(f: Fleet, i: int, w: Work, now: int, length: int) -> None:
    """Pass the packets and commands in `w.out[:length]` through the a-node, and append them as actions."""
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


# --- calls of the trusted nodes, which chain bytes; the c-node logs the same bytes. Source: RoboRebound §3.4 ---


@kernel
def plain(w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Write the entry that a trusted node would make, for robots without one. Source: docs/spec/rebound.md."""
    if ENTRY_HEAD_BYTES + length > len(w.entry):
        return -1
    w.entry[0] = kind
    put_u32(w.entry, ENTRY_T, now)
    put_u16(w.entry, ENTRY_LENGTH, length)
    copy(w.entry, ENTRY_HEAD_BYTES, payload, 0, length)
    return int(ENTRY_HEAD_BYTES + length)


@kernel
def chain(f: Fleet, i: int, w: Work, kind: int, now: int, payload: Row, length: int) -> int:
    """Let the trusted node chain a reading (INPUT), a packet (RECV, SEND) or a command (ACMD); write the entry.

    The entry is in `w.entry`. Its payload is admitted to the c-node, the radio or the actuators.
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
    """Call `chain`, and log the entry unless it is audit traffic."""
    n = chain(f, i, w, kind, now, payload, length)
    if n > 0 and f.settings[0].profile != PLAIN and (kind in (INPUT, ACMD) or not int(payload[0]) & request.AUDIT):
        log.append(f, i, w.entry, n)
    return n


# --- auditor ---


@kernel
def on_packet(f: Fleet, i: int, w: Work, now: int, packet: Row, length: int) -> int:
    """Handle a received packet: pass it to the controller, or handle it here if it is audit traffic.

    Returns: NOTHING; HEARD: the packet is logged, and a controller in plain Python must handle it; WHOLE: it completed
        a request, at `work.place[0]`, that a controller in plain Python must replay; negative: the a-node refused it.
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
        # As in the paper: auditors are chosen among the senders of states.
        rounds.mark_in_range(f, i, get_u16(packet, ID_AT), now)
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
    rounds.mark_in_range(f, i, src, now)
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
    """Check the request's form, and let the a-node issue the token to `w.small[2]`; `answer` sends it after the audit.

    Compromised robots can make any number of forged token requests, which must not use up the limit of audits. Only
    IssueToken detects them.
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


# --- auditee ---


@kernel
def on_round(f: Fleet, i: int, w: Work, now: int, listened: int, busy: int) -> None:
    """Begin a round: send HELLO, take a checkpoint, ask the first auditor. Source: RoboRebound §3.7.

    Args:
        listened: 1 if the robot has listened before this round, as in the `ROUND_AT` for it.
        busy: 1 while the radio is sending a fragment.
    """
    actions.clear(w)
    if listened or not listen(f, i, w, now):
        begin_round(f, i, w, now)
        ask(f, i, w, now, busy)


@kernel
def listen(f: Fleet, i: int, w: Work, now: int) -> bool:
    """Schedule the next round; return whether this round must wait until the robot has listened (seeking.listens)."""
    actions.append(w, actions.ROUND_AT, now + f.settings[0].t_audit, 0)
    wait_ms = seeking.listens(f, i, now, w.small[1]) if rounds.end_round(f, i) else 0
    if wait_ms > 0:
        actions.append(w, actions.ROUND_AT, now + wait_ms, 1)
    return wait_ms > 0


@kernel
def begin_round(f: Fleet, i: int, w: Work, now: int) -> None:
    """Start a round, and send HELLO or SEEK."""
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
    """Answer SEEKs and send one, as far as due; return whether it is time to ask for missing tokens."""
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
    """Send the next fragment, after the radio has sent or dropped the last one. Source: RoboRebound §5.2."""
    actions.clear(w)
    if arrived == 0:
        seeking.give_up_request(f, i, now, w.small[1])
    ask(f, i, w, now, busy)


@kernel
def ask(f: Fleet, i: int, w: Work, now: int, busy: int) -> None:
    """Send the next fragment, or set the time of the next retry; do nothing while the radio is busy."""
    if busy == 0:
        ask_with(f, i, w, now, next_fragment(f, i, w, now))


@kernel
def next_fragment(f: Fleet, i: int, w: Work, now: int) -> int:
    """Write the next fragment to `w.packet`, if need be of a new request; return its length, 0 if there is none."""
    n = request.next_fragment(f, i, now, w.packet)
    if n == 0 and request.make_request(f, i, now, w.small[0], w.small[1], w.small[2]) > 0:
        n = request.next_fragment(f, i, now, w.packet)
    return int(n)


@kernel
def ask_with(f: Fleet, i: int, w: Work, now: int, length: int) -> None:
    """Send the fragment in `w.packet`; without one, set the time of the next retry. Source: RoboRebound §5.2."""
    if length > 0:
        if send(f, i, w, now, w.packet, length, int(f.robot[i].request_to)) <= 0:
            actions.append(w, actions.RETRY_AT, request.postpone(f, i, now), 0)
        return
    at_ms = rounds.next_retry(f, i, now)
    if at_ms >= 0:
        actions.append(w, actions.RETRY_AT, at_ms, 0)
