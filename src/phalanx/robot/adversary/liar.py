"""A compromised robot: the honest `Robot` with some methods overridden, and the base class of all attacks on swarms.

An honest controller runs beside the lying c-node, with the true readings and packets. A deviation is an output that the
a-node passed and the honest controller did not return, or the reverse. So the first deviation is measured, and does not
depend on the attack's own account. An attack sees what a c-node sees, and its plan; it can only call the trusted nodes.
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
    """The adversary's knowledge and options when it takes a robot over."""

    ids: tuple[int, ...]  # every robot's id
    goal_m: tuple[float, float]  # where the swarm is going
    colluding: tuple[int, ...]  # ids of the other compromised robots
    start_ms: int  # it lies from here on, ms of the robot's own clock
    stop_ms: int  # and is honest again from here on
    chance: np.random.Generator  # the adversary's random source, seeded by the scenario
    options: Mapping[str, float | str] = field(default_factory=dict)  # the attack's options, by name


@dataclass(frozen=True, slots=True)
class Motion:
    """Position and velocity that a robot claims, or that its own sensors measure."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float


class Liar(Robot):
    """A robot that lies in one way. Honest before `plan.start_ms` and from `plan.stop_ms` on.

    While it lies, `sensed`, `heard`, `asked` and `round_due` replace what an honest c-node does at these events.

    Class attributes:
        scene: kind of run in which such an attack is tried.
        period_ms: time between calls of `on_wake` while it lies; 0 for never. An attack may set its own each time.

    Attributes:
        attack: the record of this attack; `lying` sets it.
        first_deviation_ms: when it first did what an honest robot would not; None while it has not.
        last_deviation_ms: when it did so last.
        output_missing: the first deviation is an output left out: no auditor can know before δ and the skew are over.
        gained: how much an attack on the audits gained beyond what an honest robot is due.
    """

    scene: ClassVar[Scene] = "flock"
    period_ms: int = 0
    attack: Attack

    def __init__(
        self, fleet: Fleet, i: int, work: Work, plan: Plan, make_controller: MakeController | None = None
    ) -> None:
        super().__init__(fleet, i, work, make_controller)
        self.is_own = False  # its errors are no mistakes of a researcher's controller
        self.plan = plan
        self.first_deviation_ms: int | None = None
        self.last_deviation_ms: int | None = None
        self.output_missing = False
        self.gained = 0
        self.seen: dict[int, Motion] = {}
        self.me = Motion(0.0, 0.0, 0.0, 0.0)
        self.sensed_ms = 0  # when its last reading came; in Safe Mode there are none
        bundled = compiled(fleet.settings[0].controller, fleet.params)
        self._honest = (make_controller or bundled)(self.id)
        self._steps = 0
        r = fleet.robot[i]
        if r.alive:  # taken over in the middle of a mission
            remembered = fleet.state[i, : r.state_len].tobytes()
            self._honest.decode(remembered)
            if self.controller:
                self.controller.decode(remembered)
            self._steps = int(r.step)
        self._put_out: list[Output] | None = None

    @property
    def alive_s(self) -> float:
        """Return for how many seconds it has had its mission key, until Safe Mode."""
        return (self.sensed_ms - int(self.f.robot[self.i].t_key)) / 1000

    @property
    def lied_s(self) -> float:
        """Return for how many seconds it has lied, until Safe Mode."""
        return max(0, min(self.sensed_ms, self.plan.stop_ms) - self.plan.start_ms) / 1000

    @classmethod
    def before_key(cls, rob_id: int, profile: int, anode: Row, f_max: int) -> None:
        """Act before the mission key is loaded: the c-node runs, and `anode` can be called.

        Source: docs/spec/rebound.md (zero key).
        """

    # --- events: honest while it does not lie -------------------------------------------------------------------------

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """Handle a reading, and compare what goes out with the honest controller's outputs."""
        reading = self.read(now_ms, reading)
        self.sensed_ms = now_ms
        self.me = Motion(*MOTION.unpack_from(reading)[3:]) if reading[0] == SENSOR.tag else self.me
        outputs = self._honest.on_input(self._steps, now_ms, reading)
        due = checked_outputs(outputs, int(self.f.settings[0].packet_max), self._honest)
        self._steps += 1
        self._put_out = []
        actions = self.sensed(now_ms, reading) if self.lies(now_ms) else super().on_reading(now_ms, reading)
        if self._put_out != due:
            self.deviates(now_ms, output_missing=len(self._put_out) < len(due))
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
                self.saw(rob_id, Motion(*motion))
        return self.heard(now_ms, packet) if self.lies(now_ms) else super().on_packet(now_ms, packet)

    def begin_round(self, now_ms: int) -> list[Action]:
        return self.round_due(now_ms) if self.lies(now_ms) else super().begin_round(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        """Act out of turn, every `period_ms` while it lies."""
        return []

    # --- what subclasses override -------------------------------------------------------------------------------------

    def saw(self, rob_id: int, motion: Motion) -> None:
        """Note a state that was broadcast in a robot's name; it may be a lie."""
        self.seen[rob_id] = motion

    def read(self, now_ms: int, reading: bytes) -> bytes:
        """Return the reading that the sensor gives the s-node; override it for a sensor that lies."""
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

    # --- what goes out is watched -------------------------------------------------------------------------------------

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        return self._watched(now_ms, Act(command), super().act(now_ms, command))

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        actions = super().send(now_ms, packet, to)
        return actions if packet[0] & request.AUDIT else self._watched(now_ms, Send(packet), actions)

    def _watched(self, now_ms: int, output: Output, actions: list[Action]) -> list[Action]:
        if not actions:
            return actions
        if self._put_out is None:
            self.deviates(now_ms)
        else:
            self._put_out.append(output)
        return actions

    def lies(self, now_ms: int) -> bool:
        """Return whether it lies at this moment."""
        return self.plan.start_ms <= now_ms < self.plan.stop_ms

    def deviates(self, now_ms: int, *, output_missing: bool = False) -> None:
        """Note a deviation from an honest robot at this time."""
        if self.first_deviation_ms is None:
            self.first_deviation_ms = now_ms
            self.output_missing = output_missing
        self.last_deviation_ms = now_ms

    # --- what several attacks need ------------------------------------------------------------------------------------

    def others(self) -> list[int]:
        """Return the ids of all robots but itself."""
        return [rob_id for rob_id in self.plan.ids if rob_id != self.id]

    def victims(self) -> list[int]:
        """Return the ids of all robots that are not compromised."""
        return [rob_id for rob_id in self.others() if rob_id not in self.plan.colluding]

    def nearest(self, *, but: int = 0) -> Motion:
        """Return the motion of the nearest robot that it has heard of, except `but`."""
        heard = [motion for rob_id, motion in self.seen.items() if rob_id != but]
        return min(heard, key=lambda other: math.hypot(other.x_m - self.me.x_m, other.y_m - self.me.y_m))

    def claim_motion(self, now_ms: int, name: int, motion: Iterable[float], to: int = EVERYBODY) -> list[Action]:
        """Send a state in a robot's name: position, m, and velocity, m/s."""
        return self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, *motion), to)

    def count(self, actions: list[Action]) -> list[Action]:
        """Add the packets that an attack on the audits has sent to `gained`; return them."""
        self.gained += len(actions)
        return actions

    def whole_request(self, now_ms: int, packet: bytes) -> int:
        """Store a fragment; return the place of the request if it is complete and well-formed, -1 otherwise."""
        place = int(request.take_fragment(self.f, self.i, row(packet), len(packet), now_ms))
        if place < 0:
            return -1
        q, length = self.shown(place), int(self.f.rx_info[self.i, place].len)
        src = get_u16(row(packet), request.AT_SRC)
        return place if audit.open_request(self.w, q, length, src) == 0 else -1

    def shown(self, place: int) -> Row:
        """Return the bytes of the request at this place, also right after it was released."""
        q: Row = self.f.rx.rows[self.f.rx_info[self.i, place].row]
        return q

    def vouch(self, now_ms: int, place: int) -> list[Action]:
        """Send a token to the sender of the request just opened, without an audit."""
        src = int(self.w.case[0].auditee)
        refused = audit.issue(self.f, self.i, self.w, self.shown(place), self.w.small[2])
        actions = self.answer(now_ms, place, src, refused)
        self.gained += len(actions) > 1
        return actions

    def believe(self, t_ms: int, packet: bytes) -> None:
        """Log a packet and act on it as if it had come at `t_ms`."""
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
        """Have a trusted node chain bytes, and log nothing; return the length of the entry in `work.entry`."""
        return int(handlers.chain(self.f, self.i, self.w, kind, now_ms, row(payload), len(payload)))


def tokens_in(actions: Iterable[Action]) -> list[Transmit]:
    """Return the tokens among the packets that go out."""
    return [each for each in actions if isinstance(each, Transmit) and is_audit(each.packet, request.TOKEN)]


def is_audit(packet: bytes, sub: int) -> bool:
    """Return whether a packet is AUDIT traffic of a kind: HELLO, FRAGMENT, TOKEN or SEEK of `request`."""
    return bool(request.is_audit(row(packet), len(packet))) and packet[request.AT_SUB] == sub


def lying(
    attack: Attack, fleet: Fleet, i: int, work: Work, plan: Plan, make_controller: MakeController | None = None
) -> Liar:
    """Return robot `i`, compromised by this attack; arguments as for a `Liar`."""
    liar: Liar = attack.kind(fleet, i, work, plan, make_controller)
    liar.attack = attack
    return liar
