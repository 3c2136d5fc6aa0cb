"""Attacks that are declared harmless everywhere: each bites as soon as what stops it is taken away.

Without that, one that does nothing would be as harmless.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from opened import Hole, run_with
from trials import AT_S, F_MAX, run, scenario

from phalanx.attacks import IN_FLOCKS
from phalanx.bti import fleet, request, rounds
from phalanx.config import BtiConfig
from phalanx.robot import handlers
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

# Either guard is enough, for an old token is for an old checkpoint too; but not while the same one is still pending.
OLD_TOKENS = (Hole(rounds, "on_token", " and t >= p.asked_ms and p.claimed == number"),)
OTHER_CHECKPOINTS = (Hole(rounds, "on_token", " and p.claimed == number"),)
# If newcomers push nobody out, 4 starve; if robots may also begin more than one request each T_audit / 2, all do.
# Otherwise a robot that lacks tokens seeks other auditors, and lives.
NO_ANSWERS = Hole(handlers, "handle_audit", "sub == seeking.SEEK", "False")
PLACES = (
    NO_ANSWERS,
    Hole(request, "_place", "return oldest", "return oldest if f.rx_info[i, oldest].src == 0 else -1"),
    Hole(
        request, "take_fragment", "    at = _place(f, i, src)", "    at = _place(f, i, src)\n    if at < 0: return -1"
    ),
    Hole(request, "_may_begin", " or now - f.peer[i, at].took < f.settings[0].t_audit // 2"),
)

QUIET_S = 25.0  # whoever lacks tokens from boot on has been stopped twice over


def crowd(name: str, **bti: int) -> Scenario:
    """The paper's 25 robots, of which f_max lie."""
    liars = tuple(AttackSpec(name=name, at_s=5.0) for _ in range(F_MAX))
    return Scenario(name="grid", robots=25, duration_s=45.0, bti=BtiConfig(**bti), attacks=liars)


def starved(ended: Run) -> int:
    """Correct robots in Safe Mode."""
    told = ended.summary()
    return len(told["correct_in_safe_mode"]) + len(told["without_quorum"])


def gained(ended: Run) -> list[int]:
    """Of each liar."""
    return [ended.robots[rob_id - 1].gained for rob_id in ended.compromised]


@pytest.mark.parametrize(
    "made, holes, at_least",
    [
        (crowd("slot-squat"), PLACES, 22),
        # An honest answer to every other request is a fresh token for ever if two rounds are shorter than T_val.
        pytest.param(crowd("stale-answers", t_audit_ms=6000), OLD_TOKENS, 4, marks=pytest.mark.long),
        pytest.param(crowd("wrong-checkpoint"), OTHER_CHECKPOINTS, 4, marks=pytest.mark.long),
    ],
    ids=lambda each: each.attacks[0].name if isinstance(each, Scenario) else None,
)
def test_with_its_hole_opened_it_starves_correct_robots(made, holes, at_least, monkeypatch):
    shut = run(made)
    if holes is PLACES:
        monkeypatch.setattr(fleet, "RX_SLOTS", 0)  # as many places as liars, and none besides
    opened = run_with(monkeypatch, made, *holes)
    assert starved(shut) == 0
    assert starved(opened) >= at_least
    assert all(count > 0 for count in gained(shut) + gained(opened))
    nobody_lies = run_with(monkeypatch, replace(made, attacks=(), duration_s=QUIET_S), *holes)
    assert starved(nobody_lies) == 0, "it is not the hole alone"


@pytest.mark.parametrize("robots, correct_in_range", [(7, F_MAX), (8, F_MAX + 1)])
def test_robots_that_audit_nobody_starve_those_with_fewer_than_f_max_plus_one_correct_ones_in_range(
    robots, correct_in_range
):
    """All are in range of all: the liars only have to do nothing."""
    liars = [AttackSpec(name="refuse-to-audit", at_s=AT_S) for _ in range(F_MAX)]
    ended = run(scenario("hardened", *liars, robots=robots))
    enough = correct_in_range > F_MAX
    assert starved(ended) == (0 if enough else robots - F_MAX)
    assert starved(run(scenario("hardened", robots=robots))) == 0
    assert all(count > 0 for count in gained(ended))


def test_these_are_all_that_are_harmless_everywhere():
    assert {name for name, kind in IN_FLOCKS.items() if set(kind.verdicts.values()) == {"harmless"}} == {
        "slot-squat", "stale-answers", "wrong-checkpoint", "drain", "refuse-to-audit", "talk-over",  # test_hidden.py
        "mask",  # test_mask.py
        "push-out",  # test_hub.py
        "talk-over-replies",  # test_replies.py
        "relay-hello",  # test_replies.py
    }  # fmt: skip
