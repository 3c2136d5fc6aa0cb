"""P1 to P4 where robots stand in a grid, around a hub, in a line, in a ring and on two islands, and frames are lost.

A sample of scripts/promises.py, whose table lives as many runs as wanted; and that its judges can find a promise broken.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import replace

import pytest

from commands import ROOT
from phalanx.config import BtiConfig
from phalanx.world.scenarios.run import Run
from scripts import in_this_process

pytestmark = pytest.mark.long

SAMPLE = [
    ("collude", "grid", 1, 8.0, 5.0, 1),
    ("wrong-checkpoint", "hub", 5, 4.0, 0.0, 0),
    ("omit-sends", "line", 3, 2.0, 20.0, 1),
    ("refuse-to-audit", "ring", 5, 2.0, 5.0, 0),
    ("expel", "islands", 2, 4.0, 20.0, 0),
]


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import promises

    return in_this_process(monkeypatch, promises)


def broken(script, row):
    return {name for name in script.PROMISES if getattr(row, name)}


@pytest.mark.parametrize("case", SAMPLE, ids=lambda case: " ".join(map(str, case)))
def test_the_promises_are_kept_wherever_robots_stand(script, case):
    row = script.lived(script.Case(*case))
    assert (broken(script, row), row.without_quorum) == (set(), 0), row.who
    assert row.lasted_s > row.at_s + 25


def test_robots_that_fill_their_channel_have_no_quorum(script):
    """Loss and speed make 70 robots repeat packets until the channel is full, without an attack."""
    row = script.lived(script.Case("nobody", "waypoints", 5, 2.0, 20.0, 2001))
    assert (broken(script, row), row.without_quorum) == (set(), 18), row.who


def test_a_promise_that_is_broken_is_told(script, monkeypatch):
    case = script.Case("collude", "grid", 2, 4.0, 0.0, 1)
    made = script.scenario_of(case)
    assert (len(made.attacks), made.bti.f_max) == (2, 2)

    # f_max + 2 are compromised: each gets f_max + 1 tokens from the others, and none from a correct robot.
    crowd = replace(made, robots=8, attacks=made.attacks[:1] * 4)
    monkeypatch.setattr(script, "scenario_of", lambda _: crowd)
    assert broken(script, script.lived(case)) == {"p1"}

    # Too few audits for all who need them.
    hub = script.Case("refuse-to-audit", "hub", 1, 4.0, 0.0, 0)
    monkeypatch.undo()
    monkeypatch.setattr(BtiConfig, "audits_taken", property(lambda bti: 12 * bti.f_max))
    row = script.lived(hub)
    assert "p2" in broken(script, row)
    assert row.p2 == row.who.partition("p2:")[2].partition(" ")[0].count("/") + 1


def test_who_lives_without_a_vouch_a_full_log_and_a_bucket_that_overflows_are_told(script, monkeypatch):
    made = replace(script.scenario_of(script.Case("crash", "grid", 1, 4.0, 0.0, 0)), attacks=())
    run = Run(made)
    run.advance(12.0)
    nobody = frozenset()
    rounds = [(11.0, auditor, auditee) for auditor in range(1, 26) for auditee in range(1, 26) if auditor != auditee]
    assert script.alive_unvouched(run, nobody, rounds) == set()
    assert script.alive_unvouched(run, nobody, [each for each in rounds if each[2] != 7]) == {7}
    assert script.alive_unvouched(run, nobody, [(1.8, *each[1:]) for each in rounds]) == set(run.ids.tolist()), (
        "too long ago"
    )
    assert not script.over_its_bucket(run, 3)
    run.world.air.counts[3, 3, 4] += 10_000_000
    assert script.over_its_bucket(run, 3)


def test_a_table_goes_on_where_it_was_stopped(script, monkeypatch, capsys, tmp_path):
    lived = []

    def quick(case):
        lived.append(case)
        words = {name: "" if kind is str else 0 for name, kind in script.COLUMNS.items()}
        return script.Row(**{**words, **script.asdict(case), "p2": case.seed, "who": "p2:4" * case.seed})

    monkeypatch.setattr(script, "lived", quick)
    file = tmp_path / "out" / "promises.csv"

    def called(*words):
        monkeypatch.setattr(sys, "argv", ["promises.py", "--csv", str(file), "--attacks", "crash,nan", *words])
        return script.main()

    assert called("--f-max", "1", "--t-audit", "4", "--loss", "0", "--seeds", "1") == 0
    assert len(lived) == 10
    assert called("--f-max", "1", "--t-audit", "4", "--loss", "0,20", "--seeds", "2") == 1, "odd seeds break P2"
    assert len(lived) == len(set(lived)) == 40
    with file.open() as lines:
        assert len(list(csv.reader(lines))) == 42
    assert called("--table", "--f-max", "1") == 1
    assert len(lived) == 40
    told = capsys.readouterr().out
    assert "40 runs, 20 broke a promise" in told
    assert "crash hub f_max 1 T_audit 4 s loss 20 % seed 1, 0 from 0 s: p2:4" in told
    with pytest.raises(SystemExit):
        called("--layouts", "star")


def test_a_run_ends_at_a_moment_that_its_clock_can_show(script):
    """Else it is advanced for ever: 55.352000000000004 s was one."""
    for f_max in range(1, 6):
        case = script.Case("wrong-checkpoint", "grid", f_max, 8.0, 20.0, 1)
        ends_s = script.scenario_of(case).duration_s
        assert ends_s == round(1e6 * ends_s) / 1e6
