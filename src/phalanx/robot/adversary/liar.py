"""Compromised robots: the base class of all attacks on swarms, a `Robot` that overrides some methods.

An honest controller runs in parallel, with the true readings and packets. A deviation is an output that the a-node
admitted and the honest controller did not return, or the reverse. So the first deviation is measured independently of
the attack's code. An attack knows what a c-node knows, and its plan; it can use trusted nodes only through their calls.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from phalanx.bti import audit, request
from phalanx.bti.audit import RECV
from phalanx.bti.fleet import Fleet
from phalanx.bti.work import Work
from phalanx.robot import handlers
from phalanx.robot.actions import EVERYBODY, Action, Transmit
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.python_controller import Act, Output, Send, checked_outputs
from phalanx.robot.robot import MakeController, Robot
from phalanx.wire.fields import Row, get_u16, row
from phalanx.wire.table import KIND_STATE, SENSOR, STATE

from .attack import Attack, Scene

MOTION = STATE.form  # of a `sensor` too: kind, id, t, position, velocity


@dataclass(frozen=True, slots=True)
class Plan:
    """Knowledge and options of the adversary that takes a robot over."""

    ids: tuple[int, ...]  # ids of all robots
    goal_m: tuple[float, float]  # the swarm's goal
    colluding: tuple[int, ...]  # ids of the other compromised robots
    start_ms: int  # start of the attack, ms of the robot's own clock
    stop_ms: int  # end of the attack, after which the robot is honest again
    chance: np.random.Generator  # the adversary's random generator, seeded by the scenario
    options: Mapping[str, float | str] = field(default_factory=dict)  # the attack's options, by name


@dataclass(frozen=True, slots=True)
class Motion:
    """Position and velocity that a robot claims, or that its own sensors measure."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float


class Liar(Robot):
    """Robot under an attack: dishonest from `plan.start_ms` to `plan.stop_ms`, and honest otherwise.

    While it lies, `sensed`, `heard`, `asked` and `round_due` replace the honest handling of these events.

    Class attributes:
        scene: setting in which the attack is tried.
        period_ms: time between calls of `on_wake` while it lies; 0 for never. An attack may change it at any time.

    Attributes:
        attack: the record of this attack; `lying` sets it.
        first_deviation_ms: time of the first deviation from an honest robot; None before it.
        last_deviation_ms: time of the last deviation.
        output_missing: whether the first deviation is a missing output, which auditors detect only after δ + skew.
        gained: advantage of an attack on the audits over an honest robot, as a count.
    """

    scene: ClassVar[Scene] = "flock"
    period_ms: int = 0
    attack: Attack

    def __init__(
        self, fleet: Fleet, i: int, work: Work, plan: Plan, make_controller: MakeController | None = None
    ) -> None:
        super().__init__(fleet, i, work, make_controller)
        self.is_own = False  # do not report its errors as mistakes in a user's controller
        self.plan = plan
        self.first_deviation_ms: int | None = None
        self.last_deviation_ms: int | None = None
        self.output_missing = False
        self.gained = 0
        self.seen: dict[int, Motion] = {}
        self.me = Motion(0.0, 0.0, 0.0, 0.0)
        self.sensed_ms = 0  # time of its last reading, of which there are none in Safe Mode
        bundled = compiled(fleet.settings[0].controller, fleet.params)
        self._honest = (make_controller or bundled)(self.id)
        self._steps = 0
        r = fleet.robot[i]
        if r.alive:  # taken over during a mission
            remembered = fleet.state[i, : r.state_len].tobytes()
            self._honest.decode(remembered)
            if self.controller:
                self.controller.decode(remembered)
            self._steps = int(r.step)
        self._put_out: list[Output] | None = None

    @property
    def alive_s(self) -> float:
        """Return the seconds from the mission key to Safe Mode, or to now."""
        return (self.sensed_ms - int(self.f.robot[self.i].t_key)) / 1000

    @property
    def lied_s(self) -> float:
        """Return the seconds of lying, up to Safe Mode."""
        return max(0, min(self.sensed_ms, self.plan.stop_ms) - self.plan.start_ms) / 1000

    @classmethod
    def before_key(cls, rob_id: int, profile: int, anode: Row, f_max: int) -> None:
        """Attack before the mission key is loaded, when the c-node runs and can call `anode`.

        Source: docs/spec/rebound.md (zero key).
        """

    # --- events: handled honestly while it does not lie ---------------------------------------------------------------

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """Handle a reading, and compare the outputs with those of the honest controller."""
        reading = self.read(now_ms, reading)
        self.sensed_ms = now_ms
        self.me = Motion(*MOTION.unpack_from(reading)[3:]) if reading[0] == SENSOR.tag else self.me
        outputs = self._honest.on_input(self._steps, now_ms, reading)
        due = checked_outputs(outputs, int(self.f.settings[0].packet_max), self._honest)
        self._steps += 1
        self._put_out = []
        actions = self.sensed(now_ms, reading) if self.lies(now_ms) else super().on_reading(now_ms, reading)
        if self._put_out != due:
            self.record_deviation(now_ms, output_missing=len(self._put_out) < len(due))
        self._put_out = None
        return actions

    def on_advice(self, advice: bytes) -> None:
        self._honest.on_advice(advice)
        super().on_advice(advice)

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        if not packet[0] & request.AUDIT:
            self._honest.on_recv(now_ms, packet)
            if len(packet) == STATE.size and packet[0] == KIND_STATE:
                _, rob_id, _, *motion = MOTION.unpack(packet)
                self.on_state_received(rob_id, Motion(*motion))
        return self.heard(now_ms, packet) if self.lies(now_ms) else super().on_packet(now_ms, packet)

    def begin_round(self, now_ms: int) -> list[Action]:
        return self.round_due(now_ms) if self.lies(now_ms) else super().begin_round(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        """Act at any time: called every `period_ms` while it lies."""
        return []

    # --- hooks for subclasses -----------------------------------------------------------------------------------------

    def on_state_received(self, rob_id: int, motion: Motion) -> None:
        """Record a state that was broadcast in a robot's name; it may be false."""
        self.seen[rob_id] = motion

    def read(self, now_ms: int, reading: bytes) -> bytes:
        """Return the reading that the s-node receives; override it for a manipulated sensor."""
        return reading

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Handle a reading while it lies."""
        return super().on_reading(now_ms, reading)

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Handle a packet while it lies."""
        is_request = is_audit(packet, request.FRAGMENT) and len(packet) > request.FRAGMENT_HEAD_BYTES
        return self.asked(now_ms, packet) if is_request else super().on_packet(now_ms, packet)

    def asked(self, now_ms: int, packet: bytes) -> list[Action]:
        """Handle a fragment of a request for an audit while it lies."""
        return super().on_packet(now_ms, packet)

    def round_due(self, now_ms: int) -> list[Action]:
        """Begin a round while it lies."""
        return super().begin_round(now_ms)

    # --- detection of deviations --------------------------------------------------------------------------------------

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        return self._watched(now_ms, Act(command), super().act(now_ms, command))

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        actions = super().send(now_ms, packet, to)
        return actions if packet[0] & request.AUDIT else self._watched(now_ms, Send(packet), actions)

    def _watched(self, now_ms: int, output: Output, actions: list[Action]) -> list[Action]:
        if not actions:
            return actions
        if self._put_out is None:
            self.record_deviation(now_ms)
        else:
            self._put_out.append(output)
        return actions

    def lies(self, now_ms: int) -> bool:
        """Return whether the attack is active at this time."""
        return self.plan.start_ms <= now_ms < self.plan.stop_ms

    def record_deviation(self, now_ms: int, *, output_missing: bool = False) -> None:
        """Record a deviation from an honest robot."""
        if self.first_deviation_ms is None:
            self.first_deviation_ms = now_ms
            self.output_missing = output_missing
        self.last_deviation_ms = now_ms

    # --- tools for attacks --------------------------------------------------------------------------------------------

    def others(self) -> list[int]:
        """Return the ids of all robots but itself."""
        return [rob_id for rob_id in self.plan.ids if rob_id != self.id]

    def victims(self) -> list[int]:
        """Return the ids of all robots that are not compromised."""
        return [rob_id for rob_id in self.others() if rob_id not in self.plan.colluding]

    def nearest(self, *, but: int = 0) -> Motion:
        """Return the motion of the nearest robot whose state it has received, except `but`."""
        known = [motion for rob_id, motion in self.seen.items() if rob_id != but]
        return min(known, key=lambda other: math.hypot(other.x_m - self.me.x_m, other.y_m - self.me.y_m))

    def claim_motion(self, now_ms: int, name: int, motion: Iterable[float], to: int = EVERYBODY) -> list[Action]:
        """Send a state in a robot's name: position, m, and velocity, m/s."""
        return self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, *motion), to)

    def count(self, actions: list[Action]) -> list[Action]:
        """Add the number of actions to `gained`, and return the actions."""
        self.gained += len(actions)
        return actions

    def whole_request(self, now_ms: int, packet: bytes) -> int:
        """Store a fragment; return the index of the request if it is complete and well-formed, -1 otherwise."""
        place = int(request.take_fragment(self.f, self.i, row(packet), len(packet), now_ms))
        if place < 0:
            return -1
        q, length = self.shown(place), int(self.f.rx_info[self.i, place].len)
        src = get_u16(row(packet), request.AT_SRC)
        return place if audit.open_request(self.w, q, length, src) == 0 else -1

    def shown(self, place: int) -> Row:
        """Return the bytes of the request at this index, which stay valid right after its release."""
        q: Row = self.f.rx.rows[self.f.rx_info[self.i, place].row]
        return q

    def issue_token_unaudited(self, now_ms: int, place: int) -> list[Action]:
        """Send a token to the sender of the request that was just parsed, without an audit."""
        src = int(self.w.case[0].auditee)
        refused = audit.issue(self.f, self.i, self.w, self.shown(place), self.w.small[2])
        actions = self.answer(now_ms, place, src, refused)
        self.gained += len(actions) > 1
        return actions

    def accept_packet_at(self, t_ms: int, packet: bytes) -> None:
        """Log a packet and pass it to the controller as if it had arrived at `t_ms`."""
        n = handlers.plain(self.w, RECV, t_ms, row(packet), len(packet))
        self.record(self.w.entry[:n])
        if self.controller:
            self.controller.on_recv(t_ms, packet)
            self.keep_state()
        else:
            r, s = self.f.robot[self.i], self.f.settings[0]
            state = self.f.state[self.i]
            r.state_len = dispatch.on_recv(s.controller, self.f.params, r.id, t_ms, row(packet), len(packet), state)

    def chain(self, kind: int, now_ms: int, payload: bytes) -> int:
        """Let a trusted node chain bytes without logging them; return the length of the entry in `work.entry`."""
        return int(handlers.chain(self.f, self.i, self.w, kind, now_ms, row(payload), len(payload)))


def tokens_in(actions: Iterable[Action]) -> list[Transmit]:
    """Return the packets with tokens among the actions."""
    return [each for each in actions if isinstance(each, Transmit) and is_audit(each.packet, request.TOKEN)]


def is_audit(packet: bytes, sub: int) -> bool:
    """Return whether a packet is an AUDIT packet of this kind: HELLO, FRAGMENT, TOKEN or SEEK."""
    return bool(request.is_audit(row(packet), len(packet))) and packet[request.AT_SUB] == sub


def lying(
    attack: Attack, fleet: Fleet, i: int, work: Work, plan: Plan, make_controller: MakeController | None = None
) -> Liar:
    """Return robot `i` compromised by an attack; the other arguments are those of `Liar`."""
    liar: Liar = attack.kind(fleet, i, work, plan, make_controller)
    liar.attack = attack
    return liar
