"""`phalanx attack scorecard`: what is tried, what a row says, what the table makes of rows, and a row of one's own."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from phalanx.attacks import IN_FLOCKS
from phalanx.cli import scorecard as command
from phalanx.errors import UsageError
from phalanx.lab.scorecard import bout as bouts
from phalanx.lab.scorecard.bout import OUTCOME, drive, run_bout, try_on_wheels
from phalanx.lab.scorecard.card import draw_card, lines
from phalanx.lab.scorecard.flock_trial import FlockTrial, Stop, trial_fields
from phalanx.lab.scorecard.plan import AT_S, COMMON, MISSIONS, known_protocols, scorecard_plan
from phalanx.robot.adversary.registry import attacks
from phalanx.scenarios.own import find_attack
from phalanx.scenarios.scenario import in_scenarios

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "attacks.md"
SHORT_S = 24.0


class TestPlan:
    def test_every_attack_is_tried_wherever_it_can_be_under_every_defence_and_seed(self):
        jobs = list(scorecard_plan((), (), 2).jobs)
        tried = {(dict(job.point)["protocol"], job.attack) for job in jobs}
        assert {attack for _, attack in tried} == set(attacks())
        assert {protocol for protocol, _ in tried} == {*in_scenarios(), "wheels", *MISSIONS}
        assert {name for protocol, name in tried if protocol == "wheels"} == {
            name for name, attack in attacks().items() if attack.on_wheels
        }
        assert {(protocol, name) for protocol in in_scenarios() for name in IN_FLOCKS} < tried
        assert not {("flock", "flip-bit"), ("mission", "spoof"), ("team", "flip-bit")} & tried
        assert len(jobs) == len({job.key for job in jobs}) == 6 * len(tried)
        assert [job.seed for job in jobs] == sorted(job.seed for job in jobs), "stopped, it is a smaller scorecard"

    def test_each_protocol_is_tried_in_a_scenario_of_its_own_with_time_to_stop_a_liar(self):
        for job in scorecard_plan(("hijack",), tuple(in_scenarios()), 1).jobs:
            assert job.scenario.controller == dict(job.point)["protocol"]
            assert job.scenario.attacks == ()
            bound_s = job.scenario.bti.stop_bound_ms(output_missing=True) / 1000
            assert job.scenario.duration_s >= AT_S + bound_s
            assert (job.scenario.name == "scorecard") == (job.scenario.controller in COMMON)

    def test_a_file_that_was_changed_makes_other_runs(self, tmp_path):
        own = tmp_path / "own.py"
        own.write_text(re.search(r"```python\n(.*?)\n\n\nliar =", PAGE.read_text(), re.DOTALL)[1])
        card = scorecard_plan((f"{own}:Brake",), ("flock",), 1)
        first = [job.key for job in card.jobs]
        assert [dict(job.point)["attack"] for job in card.jobs] == ["own.py:Brake"] * 3
        own.write_text(own.read_text() + "\n")
        again = [job.key for job in scorecard_plan((f"{own}:Brake",), ("flock",), 1).jobs]
        assert not set(first) & set(again)

    @pytest.mark.parametrize(
        "attacks, protocols, told",
        [
            (("spof",), (), "no attack 'spof'"),
            ((), ("flok",), "no protocol 'flok'"),
            (("flip-bit",), ("flock",), "nothing to try"),
            (("no.py:Mine",), (), "no file no.py"),
            (("hijack:until=20",), ("wheels",), "hijack:until=20 on wheels, which takes no until"),
        ],
    )
    def test_a_mistake_is_one_line(self, attacks, protocols, told):
        with pytest.raises(UsageError, match=told):
            list(scorecard_plan(attacks, protocols, 1).jobs)


STOPPED_IN_TIME = (Stop(1, 12.0, 20.0),)


def a_trial(attack="spoof", defence="hardened", stops=STOPPED_IN_TIME, harm=1.0, **attacked):
    told = {"duration_s": 60.0, "correct_in_safe_mode": [], "without_quorum": []}
    came_to = {"harm": harm, "attacked": told | attacked, "honest": told, "honest_distance_m": 0.0}
    bound_s = 10.101 if attacks()[attack].verdicts[defence] == "stopped" else None
    return FlockTrial(**trial_fields(attacks()[attack], defence), **came_to, bound_s=bound_s, stops=stops)


@pytest.mark.parametrize(
    "trial, missed",
    [
        (a_trial(), []),
        (a_trial(stops=(Stop(1, 12.0, 30.0),)), ["stopped too late"]),
        (a_trial(without_quorum=[3]), ["correct robots stopped"]),
        (a_trial(defence="none", harm=50.0, correct_in_safe_mode=[3]), []),
        (a_trial("drain", harm=1.0, correct_in_safe_mode=[3]), ["correct robots stopped", "bites"]),
        (a_trial("expel", "paper", correct_in_safe_mode=[3]), []),
    ],
)
def test_a_promise_that_is_not_kept_is_missed(trial, missed):
    assert [words for words, is_so in bouts._missed(trial, attacks()[trial.attack]).items() if is_so] == missed


class TestBout:
    @pytest.fixture
    def small(self, monkeypatch):
        def small(name, defence):
            monkeypatch.setattr(bouts, "AT_S", 5.0)
            (job,) = (each for each in scorecard_plan((name,), ("flock",), 1).jobs if each.defence == defence)
            return replace(job, scenario=replace(job.scenario, robots=6, duration_s=SHORT_S))

        return small

    def test_a_row_is_the_attack_beside_the_same_without_it(self, small):
        bare, kept = (run_bout(small("hijack", defence)) for defence in ("none", "hardened"))
        assert set(bare) == set(kept) == set(OUTCOME)
        assert (bare["declared"], bare["stopped"], bare["bound_s"], bare["deviated"]) == ("bites", 0, None, 1)
        assert (kept["declared"], kept["stopped"], kept["missed"]) == ("stopped", 1, "")
        assert 0 < kept["slowest_stop_s"] <= kept["bound_s"]
        assert bare["harm"] > kept["harm"] > 0
        assert kept["audit_bytes_per_s"] > bare["audit_bytes_per_s"] == 0

    def test_attacks_of_a_seed_are_compared_with_one_honest_run(self, small):
        bouts._honest.cache_clear()
        for name in ("hijack", "crash"):
            run_bout(small(name, "none"))
        assert (bouts._honest.cache_info().misses, bouts._honest.cache_info().hits) == (1, 1)

    def test_on_wheels_a_liar_is_stopped_in_time_and_nobody_else(self):
        bare, kept = (
            run_bout(job) for job in scorecard_plan(("hijack",), ("wheels",), 1).jobs if job.defence != "paper"
        )
        assert (bare["stopped"], bare["bound_s"], bare["deviated"]) == (0, None, 1)
        assert (kept["stopped"], kept["correct_stopped"], kept["missed"]) == (1, 0, "")
        assert 0 < kept["slowest_stop_s"] <= kept["bound_s"]
        assert kept["audit_bytes_per_s"] > 0 == bare["audit_bytes_per_s"]

    def test_on_wheels_an_attack_begins_when_its_words_say_so(self):
        spec = find_attack("hijack:at=2")
        swarm = drive("none", 0, 3.0, spec)
        ((i, liar),) = swarm.liars.items()
        began_ms = liar.first_deviation_ms - int(swarm.world.boot_us[i]) // 1000
        assert 2000 <= began_ms <= 3000
        with pytest.raises(UsageError, match="hijack begins at 2 s, when the run is over"):
            try_on_wheels(spec, "none", 0, 2.0)

    def test_a_mission_s_row_says_whether_its_verdict_was_kept(self):
        for job in scorecard_plan(("replay-day",), (), 1).jobs:
            row = run_bout(job)
            assert (row["missed"], row["stopped"]) == ("", int(job.defence == "hardened"))
            assert row["harm"] == (0 if job.defence == "hardened" else 2)


def a_row(seed, defence="hardened", harm=2.0, stop_s=8.0, **more):
    row = dict.fromkeys(OUTCOME) | {"declared": "stopped", "harm": harm, "harm_unit": "m", "bites_from": 1.0}
    row |= {"liars": 1, "deviated": 1, "stopped": 1, "slowest_stop_s": stop_s, "bound_s": 10.101, "missed": ""}
    row |= {"correct_stopped": 0, "audit_bytes_per_s": 2500.0}
    return row | {"protocol": "flock", "attack": "spoof", "defence": defence, "seed": seed} | more


class TestTable:
    def test_a_saved_run_under_the_old_name_of_a_defence_is_refused(self):
        with pytest.raises(UsageError, match="defence 'bound'") as refused:
            lines([a_row(0, defence="bound")])
        assert refused.value.hint.startswith("did you mean hardened?")

    def test_a_line_is_over_the_seeds_and_beside_no_defence(self):
        rows = [
            a_row(0),
            a_row(1, harm=5.0, stop_s=9.5),
            a_row(2, harm=3.0, stop_s=8.5, missed="bites", correct_stopped=2),
        ]
        bare = [a_row(seed, "none", 20.0 + seed, None, deviated=1, stopped=0, bound_s=None) for seed in range(3)]
        none, hardened = lines([*rows, *bare])
        assert (none.defence, none.stop_worst_s, none.harm_undefended) == ("none", None, 21.0)
        assert (hardened.harm, hardened.harm_worst, hardened.harm_undefended) == (3.0, 5.0, 21.0)
        assert (hardened.stop_median_s, hardened.stop_worst_s, hardened.bound_s) == (8.5, 9.5, 10.101)
        assert (hardened.runs, hardened.stopped, hardened.correct_stopped) == (3, 3, 2)
        assert (hardened.misses, hardened.missed) == (1, "bites (1)")

    def test_of_an_attack_that_was_changed_the_newer_run_counts(self):
        (line,) = lines([a_row(0, harm=9.0), a_row(0, harm=1.0)])
        assert (line.runs, line.harm) == (1, 1.0)

    def test_each_protocol_has_a_picture(self, tmp_path):
        pytest.importorskip("matplotlib")
        own = a_row(0, protocol="own.py:Mine", attack="skip-node", slowest_stop_s=None)
        made = draw_card(tmp_path, lines([a_row(0), own]), "1")
        assert [path.name for path in made] == [
            "scorecard-flock.png", "scorecard-flock.svg", "scorecard-own-py-Mine.png", "scorecard-own-py-Mine.svg",
        ]  # fmt: skip
        assert "<!-- ours (hardened)" in made[1].read_text()


class TestCommand:
    @pytest.fixture
    def here(self, monkeypatch):
        """Runs are made in this process."""

        def run_sweep(card, store, *_, run, **_more):
            for job in card.jobs:
                if job.key not in store.done:
                    store.add(job, run(job))
            return []

        monkeypatch.setattr("phalanx.cli.sweep.run_sweep", run_sweep)

    def test_a_row_of_one_s_own_is_added_to_the_table(self, here, phalanx, tmp_path, monkeypatch):
        pytest.importorskip("matplotlib")
        made = []
        own = tmp_path / "own.py"
        own.write_text(re.search(r"```python\n(.*?)\n\n\nliar =", PAGE.read_text(), re.DOTALL)[1])
        words = ("attack", "scorecard", "--controller", "flock", "--out", str(tmp_path / "out"))
        row_only = lambda job: {name: value for name, value in a_row(0).items() if name in OUTCOME}
        monkeypatch.setattr(command, "run_bout", lambda job: made.append(job) or row_only(job))
        code, out, err = phalanx(*words, "hijack", "--seeds", "2")
        assert code == 0, err
        assert out.splitlines()[0].split()[:4] == ["protocol", "attack", "defence", "declared"]
        assert len(made) == 6
        code, out, err = phalanx(*words, f"{own}:Brake", "--seeds", "1", "--json")
        assert code == 0, err
        told = json.loads(out)
        assert [(each["attack"], each["runs"]) for each in told["lines"]] == [("hijack", 2)] * 3 + [
            ("own.py:Brake", 1)
        ] * 3
        with Path(told["csv"]).open() as file:
            assert [row["attack"] for row in csv.DictReader(file)] == ["hijack"] * 3 + ["own.py:Brake"] * 3
        phalanx(*words, "hijack", "--seeds", "2")
        assert len(made) == 9, "nothing is run again"

    def test_a_promise_of_ours_that_was_not_kept_ends_with_1(self, here, phalanx, tmp_path, monkeypatch):
        rows = {name: value for name, value in a_row(0, missed="stopped too late").items() if name in OUTCOME}
        monkeypatch.setattr(command, "run_bout", lambda _job: rows)
        code, out, _ = phalanx("attack", "scorecard", "hijack", "--controller", "flock", "--out", str(tmp_path))
        assert code == 1
        assert "stopped too late (3)" in out

    @pytest.mark.long
    def test_other_processes_make_the_runs(self, phalanx, tmp_path):
        words = ("attack", "scorecard", "hijack", "--controller", "flock", "--seeds", "1", "--workers", "2")
        code, out, err = phalanx(*words, "--out", str(tmp_path), "--json")
        assert code == 0, err
        assert [each["stopped"] for each in json.loads(out)["lines"]] == [0, 1, 1]


def test_the_protocols_are_those_that_scenarios_run():
    assert known_protocols() == [*in_scenarios(), "wheels", "mission", "team"]
