"""Attacks that change commands or omit duties: broadcasting, being audited, auditing, or running at all.

Attacks on audits derive from these classes, and hide the misbehaviour.
"""

from __future__ import annotations

from typing import ClassVar

from phalanx.bti.audit import INPUT
from phalanx.robot.actions import Action
from phalanx.robot.adversary.liar import MOTION, Liar
from phalanx.robot.controllers.python_controller import Act, Send
from phalanx.wire.table import ACCELERATION, KIND_ACCELERATION, SENSOR, WHEELS_COMMAND

COMMAND = ACCELERATION.form
FULL_MPS2 = 5.0
# Gains of the ramming controller: it reaches its victim within a few seconds, and does not overshoot.
SPRING_PER_S2, DAMPER_PER_S = 0.3, 1.1
# On wheels: left and right, percent. A wide circle, so that it meets others and does not end at a wall.
RUNAWAY_PCT = bytes((100, 80))


class Hijack(Liar):
    """Ram the nearest robot instead of obeying the controller.

    Source: RoboRebound §2.2 (arbitrary commands); the ram is ours.
    """

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        if self.lies(now_ms) and isinstance(output, Act):
            if len(output.payload) == ACCELERATION.size:
                output = Act(COMMAND.pack(KIND_ACCELERATION, self.id, now_ms, *self.wanted_mps2()))
            elif len(output.payload) == WHEELS_COMMAND.size:
                at = WHEELS_COMMAND.at("left")
                output = Act(output.payload[:at] + RUNAWAY_PCT + output.payload[at + len(RUNAWAY_PCT) :])
        return super().send_output(now_ms, output)

    def wanted_mps2(self) -> tuple[float, float]:
        """Return an acceleration, m/s², towards the nearest known robot, matching its velocity."""
        if not self.seen:
            return FULL_MPS2, FULL_MPS2
        me, victim = self.me, self.nearest()
        ax = SPRING_PER_S2 * (victim.x_m - me.x_m) + DAMPER_PER_S * (victim.vx_mps - me.vx_mps)
        ay = SPRING_PER_S2 * (victim.y_m - me.y_m) + DAMPER_PER_S * (victim.vy_mps - me.vy_mps)
        return _limited(ax), _limited(ay)


class Flee(Hijack):
    """Drive away from the goal, out of every auditor's range."""

    def wanted_mps2(self) -> tuple[float, float]:
        away_x, away_y = self.me.x_m - self.plan.goal_m[0], self.me.y_m - self.plan.goal_m[1]
        far = max(abs(away_x), abs(away_y), 1e-9)
        return FULL_MPS2 * away_x / far, FULL_MPS2 * away_y / far


class Nondeterministic(Liar):
    """Flip the last bit of commands at random, a fault: as with a controller that uses a random source."""

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        if self.lies(now_ms) and isinstance(output, Act) and len(output.payload) == ACCELERATION.size:
            command = bytearray(output.payload)
            command[ACCELERATION.at("ax_mps2")] ^= int(self.plan.chance.integers(2))  # the lowest bit of ax
            output = Act(bytes(command))
        return super().send_output(now_ms, output)


class Dawdle(Liar):
    """Act correctly, but take each reading and send each output as late as the rules allow."""

    # The harm is small but no noise: without the delay the run is identical to the bit, and among the twelve robots of
    # docs/reference/attacks.md one that delays by the period alone stays within 2 mm of it
    # (tests/attacks/test_small_harm.py).
    period_ms = 5

    POLLS_MS: ClassVar[int] = 90  # after the reading is due, plus up to one period
    DELAY_MS: ClassVar[int] = 85  # after the reading, plus up to one period

    _round_waits = False
    _reading: tuple[int, bytes] | None = None
    _told_mps2 = 0.0, 0.0
    _waiting: tuple[tuple[int, Send | Act], ...] = ()

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """Hold a reading back; `on_wake` hands it to the s-node later, extrapolated to that time."""
        if not self.lies(now_ms) or reading[0] != SENSOR.tag or not self.POLLS_MS:
            return super().on_reading(now_ms, reading)
        self._reading = now_ms, reading
        return []

    def _moved(self, now_ms: int, was_ms: int, reading: bytes) -> bytes:
        """Return the reading that the sensor would give at `now_ms`, from the one at `was_ms`."""
        dt = (now_ms - was_ms) / 1000
        kind, rob_id, _, *motion = MOTION.unpack_from(reading)
        x_m, y_m, vx_mps, vy_mps = motion
        ax, ay = self._told_mps2
        place = x_m + vx_mps * dt + ax * dt * dt / 2, y_m + vy_mps * dt + ay * dt * dt / 2
        return MOTION.pack(kind, rob_id, now_ms, *place, vx_mps + ax * dt, vy_mps + ay * dt) + reading[SENSOR.size :]

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        if len(command) == ACCELERATION.size:
            self._told_mps2 = COMMAND.unpack(command)[3:]
        return super().act(now_ms, command)

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Run the controller at once; delay its outputs."""
        n = self.chain(INPUT, now_ms, reading)
        if n > 0:
            self.record(self.w.entry[:n])
            self._waiting = tuple((now_ms + self.DELAY_MS, output) for output in self.decide(n))
        # Replay expects these outputs by now; none is late yet.
        self._put_out = [output for _, output in self._waiting]
        return []

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send outputs that have waited long enough, and then begin a round that became due meanwhile."""
        actions: list[Action] = []
        if self._reading and self._reading[0] + self.POLLS_MS <= now_ms:
            (was_ms, reading), self._reading = self._reading, None
            actions += super().on_reading(now_ms, self._moved(now_ms, was_ms, reading))
        self._put_out = []
        due = [output for at_ms, output in self._waiting if at_ms <= now_ms]
        self._waiting = self._waiting[len(due) :]
        for output in due:
            actions += self.send_output(now_ms, output)
        self._put_out = None
        if self._round_waits and not self._waiting:
            self._round_waits = False
            actions += super().round_due(now_ms)
        return actions

    def round_due(self, now_ms: int) -> list[Action]:
        """Wait: a checkpoint must not be taken while outputs are pending."""
        if self._waiting:
            self._round_waits = True
            return []
        return super().round_due(now_ms)


class OmitSends(Liar):
    """Stop broadcasting its state, so that other robots do not keep clear of it."""

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        return [] if self.lies(now_ms) and isinstance(output, Send) else super().send_output(now_ms, output)


class Unasked(Liar):
    """Request no audits and show no log; abort a request in progress."""

    def round_due(self, now_ms: int) -> list[Action]:
        return []

    def next_packet(self, now_ms: int) -> list[Action]:
        return [] if self.lies(now_ms) else super().next_packet(now_ms)


class RefuseAudit(Unasked, Hijack):
    """Ram, request no audits and show no log."""


class RefuseToAudit(Liar):
    """Accept audit requests and never answer: each one uses up a request of the auditee."""

    def asked(self, now_ms: int, packet: bytes) -> list[Action]:
        self.gained += 1
        return []


class Crash(Unasked):
    """Stop the c-node: the actuators continue with their last command."""

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        return []

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        return []


def _limited(value: float) -> float:
    return max(-FULL_MPS2, min(FULL_MPS2, value))
