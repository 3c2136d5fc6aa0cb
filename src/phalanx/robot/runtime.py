"""One robot outside the simulator, with its timers.

It is a state machine without I/O: the caller has the clock, the sensors, the radio and the actuators. The caller looks
up the next event that is due, calls its method, and carries out the returned actions. The same readings, packets and
times give the same log as in the simulator, byte for byte. Source: docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

import heapq

from phalanx.bti import rounds, trusted
from phalanx.config import BtiConfig

from .actions import Action, Actuate, RetryAt, RoundAt, Transmit, Verdict
from .adversary.liar import Liar
from .robot import Robot

# Shortest time from the mission key to the first round; a random delay of each robot is added.
FIRST_ROUND_MS = 200
NEVER_MS = 1 << 62
Done = Transmit | Actuate | Verdict


def first_round_ms(mission_seed: int, rob_id: int, t_audit_ms: int) -> int:
    """Return the ms from the mission key to a robot's first round; further rounds follow every T_audit.

    Auditors that are not known in the first round can still be asked in the second, before T_val is over.
    """
    return FIRST_ROUND_MS + int(rounds.mix_hash(mission_seed + 1, rob_id)) % t_audit_ms


class Runtime:
    """Robot whose mission key was loaded at `now_ms` of its trusted nodes' clock, with the times of its next events.

    Attributes:
        check_ms: time of the a-node's next check of its tokens.
        wake_ms: time of the next call of an attack's `on_wake`.
        in_safe_mode: whether the a-node has stopped the robot; then no event is due.
    """

    def __init__(self, robot: Robot, config: BtiConfig, now_ms: int) -> None:
        self.robot, self._config = robot, config
        self.in_safe_mode = False
        robot.on_boot(now_ms)
        seed = int(robot.f.settings[0].mission_seed)
        # Heap of rounds: (time, whether the robot has listened before it).
        self._rounds = [(now_ms + first_round_ms(seed, robot.id, config.t_audit_ms), False)]
        self._retry_ms = NEVER_MS
        self.check_ms = now_ms + config.p_check_ms
        self.wake_ms = NEVER_MS
        if isinstance(robot, Liar) and robot.period_ms:
            self.wake_ms = max(now_ms + robot.period_ms, robot.plan.start_ms)
        self._step = 0

    @property
    def input_ms(self) -> int:
        """Return when the sensors must be read next, on the grid that auditors check."""
        return int(rounds.grid(self.robot.f, self.robot.i, self._step))

    @property
    def audit_ms(self) -> int:
        """Return when the next round or retry is due."""
        return min(self._rounds[0][0], self._retry_ms)

    @property
    def due_ms(self) -> int:
        """Return when the next reading, round, retry, check or wake-up is due."""
        return min(self.input_ms, self.audit_ms, self.check_ms, self.wake_ms)

    def on_reading(self, now_ms: int, reading: bytes, advice: bytes = b"") -> list[Done]:
        """Handle a planner's advice, if any, and then a reading."""
        self._step += 1
        if advice:
            self.robot.on_advice(advice)
        return self._set_timers(now_ms, self.robot.on_reading(now_ms, reading))

    def on_audit(self, now_ms: int) -> list[Done]:
        """Handle the round or the retry that was due at `audit_ms`."""
        if self._retry_ms < self._rounds[0][0]:
            self._retry_ms = NEVER_MS
            return self._set_timers(now_ms, self.robot.on_retry(now_ms))
        due_ms, listened = heapq.heappop(self._rounds)
        return self._set_timers(now_ms, self.robot.on_round(now_ms, listened=listened), now_ms - due_ms)

    def on_wake(self, now_ms: int) -> list[Done]:
        """Call an attack's `on_wake`."""
        assert isinstance(self.robot, Liar)
        done = self._set_timers(now_ms, self.robot.on_wake(now_ms) if self.robot.lies(now_ms) else [])
        self.wake_ms = now_ms + self.robot.period_ms
        return done

    def on_check(self, now_ms: int) -> bool:
        """Let the a-node check its tokens; return whether it has stopped the robot."""
        self.check_ms += self._config.p_check_ms
        fleet, i = self.robot.f, self.robot.i
        self.in_safe_mode = bool(trusted.anode_check(int(fleet.settings[0].profile), fleet.anode[i], now_ms))
        return self.in_safe_mode

    def on_packet(self, now_ms: int, packet: bytes) -> list[Done]:
        """Handle a packet of any bytes."""
        return self._set_timers(now_ms, self.robot.on_packet(now_ms, packet)) if packet else []

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Done]:
        """Send the next fragment of an audit request, after the radio has sent or dropped the last one."""
        return self._set_timers(now_ms, self.robot.on_sent(now_ms, arrived=arrived))

    def _set_timers(self, now_ms: int, actions: list[Action], late_ms: int = 0) -> list[Done]:
        """Set the timers of RoundAt and RetryAt actions, and return the other actions."""
        done: list[Done] = []
        for action in actions:
            if isinstance(action, RoundAt):
                # A late round does not delay the following ones.
                at_ms = action.at_ms if action.listened else action.at_ms - late_ms
                heapq.heappush(self._rounds, (at_ms, action.listened))
            elif isinstance(action, RetryAt):
                self._retry_ms = min(self._retry_ms, max(action.at_ms, now_ms))
            else:
                done.append(action)
        return done
