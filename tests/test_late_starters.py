"""Robots whose mission key is loaded later than others': they are audited from their boot on; who is early has T_val."""

from __future__ import annotations

import pytest

from phalanx.config import BtiConfig
from phalanx.robot import handlers
from phalanx.robot.runtime import first_round_ms
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited import loop, setup
from phalanx.world.audited.events import push
from phalanx.world.audited.world import clock_ms
from phalanx.world.scenarios.run import Run

F_MAX = 1


class Nodes(setup.Nodes):
    """Some robots' nodes are given no mission key until `start`."""

    late = 0  # so many, the last of all

    def load_mission(self, i, now_ms, key):
        self.key = key
        if i < len(self.anode) - self.late:
            super().load_mission(i, now_ms, key)

    def start(self, run: Run, i: int) -> None:
        """At a multiple of T_control: the world looks at sensors then."""
        world, now_ms = run.world, clock_ms(run.world, i)
        super().load_mission(i, now_ms, self.key)
        world.safe[i], world.air.nic["off"][i] = 0, 0
        handlers.on_boot(world.fleet, i, now_ms)
        t_audit_ms = int(world.fleet.settings[0].t_audit)
        first_ms = first_round_ms(run.scenario.seed, i + 1, t_audit_ms)
        push(world.queue, int(world.clock[0].now_us) + 1000 * first_ms, loop.ROUND, i, 0)


def stopped(monkeypatch: pytest.MonkeyPatch, late: int, late_s: float) -> tuple[list[int], Run]:
    """Who is in Safe Mode, of nine robots of which the last are late."""
    monkeypatch.setattr(Nodes, "late", late)
    made: list[Nodes] = []

    def make_nodes(*about):
        made.append(Nodes(*about))
        return made[0]

    run = Run(Scenario(robots=9, duration_s=late_s + 13.0, bti=BtiConfig(f_max=F_MAX)), make_nodes=make_nodes)
    behind = range(9 - late, 9)
    for i in behind:
        run.world.safe[i], run.world.air.nic["off"][i] = 1, 1
    run.advance(late_s)
    for i in behind:
        made[0].start(run, i)
    run.advance(run.scenario.duration_s)
    assert not any(why for *_, why in run.new_verdicts()), "nobody was refused"
    return [int(i) + 1 for i in run.in_safe_mode.nonzero()[0]], run


def test_who_starts_in_the_middle_of_a_mission_lives_on_and_is_audited(monkeypatch):
    safe, run = stopped(monkeypatch, late=1, late_s=15.0)
    assert safe == []
    assert run.world.fleet.robot[8].tokens_got >= 3 * (F_MAX + 1)


@pytest.mark.parametrize("late_s, safe", [(5.0, []), (11.0, [1, 2])])
def test_who_started_early_waits_for_f_max_plus_one_others_no_longer_than_t_val(late_s, safe, monkeypatch):
    assert stopped(monkeypatch, late=7, late_s=late_s)[0] == safe
