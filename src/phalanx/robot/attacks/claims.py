"""False words about who and where the robot is: in another name, in its own, another to each, or not even a number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from phalanx.bti.fleet import PLAIN
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.wire.table import KIND_STATE

from .liar import MOTION, Liar, Motion
from .silence import OmitSends
from .spoof import spoofed_state

INVENTED = 60_000  # ids from here on are nobody's


class Masquerade(OmitSends):
    """Is another robot: all that it broadcasts bears that robot's id, and stands before the nearest victim.

    Source: RoboRebound §2.4, Fig. 2.
    """

    period_ms = 250

    def on_wake(self, now_ms: int) -> list[Action]:
        """What the other robot is claimed to say."""
        if len(self.seen) < 2:
            return []
        mask = min(self.seen)
        victim = self.nearest({rob_id: motion for rob_id, motion in self.seen.items() if rob_id != mask})
        return self.send(now_ms, _in_the_way(mask, now_ms, victim, self.plan.goal_m), EVERYBODY)

    def nearest(self, robots: Mapping[int, Motion]) -> Motion:
        """Of some robots the one that is nearest."""
        return min(robots.values(), key=lambda other: math.hypot(other.x_m - self.me.x_m, other.y_m - self.me.y_m))


class FalseState(Masquerade):
    """Says of itself that it stands in the nearest robot's way."""

    def on_wake(self, now_ms: int) -> list[Action]:
        """Its own state, as it tells it."""
        if not self.seen:
            return []
        return self.send(now_ms, _in_the_way(self.id, now_ms, self.nearest(self.seen), self.plan.goal_m), EVERYBODY)


class Equivocate(FalseState):
    """Tells each victim another state of its own: to each alone where it can, else one after the other to all."""

    def on_wake(self, now_ms: int) -> list[Action]:
        """To each its own."""
        alone = self.profile == PLAIN
        actions: list[Action] = []
        for victim, motion in sorted(self.seen.items()):
            state = _in_the_way(self.id, now_ms, motion, self.plan.goal_m)
            actions += self.send(now_ms, state, victim if alone else EVERYBODY)
        return actions


class Expel(Liar):
    """Says that invented robots race past those that are farthest out, away from the swarm: who keeps pace is lost.

    Lost for good: out of range nobody audits it, and it stops there. As fast as no decoder drops, in as many names as a
    table holds, one after the other as the a-node lets words out.
    """

    period_ms = 20
    FASTEST_MPS: ClassVar[float] = 1e6
    NAMES: ClassVar[int] = 24
    VICTIMS: ClassVar[int] = 3
    _turn = 0

    def on_wake(self, now_ms: int) -> list[Action]:
        """One more of them, when the bucket is full enough for it."""
        if len(self.seen) < 2:
            return []
        middle_x, middle_y = (sum(each) / len(self.seen) for each in zip(*map(_place, self.seen.values()), strict=True))

        def out_m(other: Motion) -> float:
            return math.hypot(other.x_m - middle_x, other.y_m - middle_y)

        victims = sorted((self.seen[name] for name in self.plan.ids if name in self.seen), key=out_m)[-self.VICTIMS :]
        victim = victims[self._turn % len(victims)]
        far_m = max(out_m(victim), 1e-9)
        away_x, away_y = (victim.x_m - middle_x) / far_m, (victim.y_m - middle_y) / far_m
        claim = victim.x_m - away_x, victim.y_m - away_y, self.FASTEST_MPS * away_x, self.FASTEST_MPS * away_y
        name = INVENTED + self._turn % self.NAMES
        actions = self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, *claim), EVERYBODY)
        self._turn += bool(actions)
        return actions


class NotANumber(Liar):
    """Broadcasts states of NaN and infinity in every name: arithmetic on one of them never ends being NaN."""

    period_ms = 100

    def on_wake(self, now_ms: int) -> list[Action]:
        """One more of them."""
        others = [rob_id for rob_id in self.plan.ids if rob_id != self.id]
        name = others[int(self.plan.chance.integers(len(others)))] if others else self.id
        numbers = [(math.nan, 0.0, -math.inf, 1e30)[int(each)] for each in self.plan.chance.integers(0, 4, 4)]
        numbers[int(self.plan.chance.integers(2))] = math.nan  # of the place, which every controller reads
        return self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, *numbers), EVERYBODY)


def _place(motion: Motion) -> tuple[float, float]:
    return motion.x_m, motion.y_m


def _in_the_way(name: int, now_ms: int, victim: Motion, goal_m: tuple[float, float]) -> bytes:
    return MOTION.pack(KIND_STATE, name, now_ms, *spoofed_state((victim.x_m, victim.y_m), goal_m))
