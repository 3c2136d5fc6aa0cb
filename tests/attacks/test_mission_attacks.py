"""Each attack on a mission does what it says to a plain robot, to the paper's and to ours; and a verdict can be wrong."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from phalanx.attacks import ATTACKS
from phalanx.attacks.missions.between import Between, NudgeCode, Slip, SpoofScan
from phalanx.cli.main import run_command
from phalanx.config.defence import DEFENCES
from phalanx.lab.scorecard.errand import shelf_errand
from phalanx.lab.scorecard.mission_trial import (
    ROBOT,
    Operator,
    honest_errand,
    is_kept,
    plan_of,
    try_mission_attack,
    walk,
)
from phalanx.robot.adversary.harm import ErrandOutcome
from phalanx.robot.adversary.registry import attacks

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "attacks.md"
ON_MISSIONS = {name: attack for name, attack in sorted(attacks().items()) if not attack.in_swarm}
WALKED = [name for name, attack in ON_MISSIONS.items() if attack.scene == "errand"]
# Why a robot of ours does not begin, where it does not.
REFUSED_FOR = {
    "flip-bit": "not_authentic",
    "forge-graph": "unsigned",
    "replay-day": "outside_window",
    "replay-robot": "not_for_us",
    "replay-again": "already_started",
}


@cache
def trial(name: str, defence: str):
    return try_mission_attack(ATTACKS[name], defence)


def attacked(attack: type[Between], defence: str, *, checked: bool = True, **options: float) -> ErrandOutcome:
    """What becomes of the robot; for attacks that are not in the library."""
    plan = plan_of(defence, 0, options.pop("at", attack.starts_s), options)
    return walk(attack(plan), Operator(defence, 0).send(shelf_errand(), ROBOT, 1), defence, 0, checked=checked)


def was_stopped(robot: ErrandOutcome) -> None:
    assert robot.held
    assert not robot.done
    assert robot.refused or robot.not_validated, "it says why"
    assert robot.wrong_actions == ()
    assert robot.false_nodes == robot.false_fixes == 0


def was_not_harmed(robot: ErrandOutcome) -> None:
    assert robot.done
    assert robot.actions == ("pick", "hand_over")
    assert robot.wrong_actions == ()
    assert robot.false_nodes == 0


# Each against ours. An attack that does nothing would not be stopped, but it would be harmless: what ours does not stop
# runs in turn against one of the others. The rest when there is time.
TRIED = [
    pytest.param(name, defence, marks=() if defence in needed else pytest.mark.long)
    for i, name in enumerate(WALKED)
    for stopped in [ON_MISSIONS[name].verdicts["hardened"] == "stopped"]
    for needed in [{"hardened"} if stopped else {"hardened", ("paper", "none")[i % 2]}]
    for defence in DEFENCES
]


@pytest.mark.parametrize(("name", "defence"), TRIED)
def test_the_attack_comes_to_what_it_declares(name, defence):
    seen, kind = trial(name, defence), ON_MISSIONS[name]
    robot = seen.attacked
    assert seen.kept
    match kind.verdicts[defence]:
        case "stopped":
            was_stopped(robot)
            assert robot.refused == (REFUSED_FOR.get(name, "") if defence == "hardened" else robot.refused)
        case "harmless":
            was_not_harmed(robot)
            assert seen.harm < kind.bites_from
        case "limited":
            assert robot.done or robot.not_validated, "it says why it is not"
            assert len(robot.wrong_actions) == robot.false_nodes == 0
            assert kind.bites_from <= seen.harm <= kind.limit
        case "bites":
            assert seen.harm >= kind.bites_from
            assert robot.wrong_actions or robot.false_nodes
        case "not covered":
            assert seen.harm >= kind.bites_from
            if kind.against == "sensors":
                assert robot.false_nodes == len(robot.wrong_actions) == 0, "led astray, and nothing done"


@pytest.mark.parametrize("defence", DEFENCES)
def test_without_an_attack_the_errand_is_done_and_without_a_release_it_is_not(defence):
    was_not_harmed(honest_errand(defence, 0))
    waiting = honest_errand(defence, 0, released=False)
    assert waiting.held
    assert waiting.actions == ("pick",)


def test_every_attack_bites_somewhere_or_is_a_fault_that_only_who_looks_for_landmarks_feels():
    for name in WALKED:
        verdicts = ON_MISSIONS[name].verdicts
        bites = {defence for defence, verdict in verdicts.items() if verdict in ("bites", "not covered")}
        assert bites or name in ("swap-key", "nudge-code", "drown-message", "freeze-scan"), name
        assert verdicts["hardened"] != "bites"


@pytest.mark.parametrize(
    "name, defence, wrong",
    [
        ("move-code", "none", {"stopped", "harmless"}),
        ("move-code", "hardened", {"harmless", "bites", "not covered"}),
        ("nudge-code", "hardened", {"stopped", "bites"}),
        ("freeze-scan", "hardened", {"stopped", "harmless"}),
        ("drag-scan", "hardened", {"stopped", "harmless", "limited"}),
        ("swap-key", "none", {"stopped", "bites"}),
    ],
)
def test_a_verdict_that_is_not_what_was_seen_is_not_kept(name, defence, wrong):
    seen = trial(name, defence)
    for verdict in wrong:
        assert not is_kept(verdict, ON_MISSIONS[name], seen.attacked, seen.harm), verdict


def test_a_robot_whose_code_was_moved_goes_back_to_its_last_validated_node_and_says_why():
    robot = trial("move-code", "hardened").attacked
    assert robot.decoded == (0, 1, 2)
    assert robot.not_validated == ("timed out", "timed out", "timed out", "no way left")
    assert robot.from_last_m < 0.8
    assert robot.pose_error_m < 0.1


def test_a_code_moved_by_more_than_the_search_reaches_does_not_decode():
    class Farther(NudgeCode):
        SIDE_M = 0.9

    was_stopped(attacked(Farther, "hardened"))


def test_wheels_that_slip_by_less_than_a_tenth_are_only_drift():
    class Little(Slip):
        SHARES = (0.92, 0.92)

    was_not_harmed(attacked(Little, "hardened"))


def test_another_room_seen_when_the_robot_is_on_its_way_is_as_useless():
    was_stopped(attacked(SpoofScan, "hardened", at=8.0))


def test_the_same_seed_gives_the_same_again_and_another_does_not():
    again, other = (try_mission_attack(ATTACKS["dead-wheel"], "hardened", seed).attacked for seed in (0, 1))
    assert trial("dead-wheel", "hardened").attacked == again != other


def test_the_page_about_attacks_has_each_on_missions_with_its_verdicts():
    rows = {}
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 7 and cells[0].startswith("`"):
            rows[cells[0].strip("`")] = cells[1:]
    assert sorted(rows) == list(ON_MISSIONS)
    for name, (against, _, *verdicts, _) in rows.items():
        assert against == ON_MISSIONS[name].against
        for defence, words in zip(DEFENCES, verdicts):
            assert words.startswith(ON_MISSIONS[name].verdicts[defence]), (name, defence)


class TestCommand:
    @pytest.fixture
    def phalanx(self, capsys):
        def call(*words: str):
            code = run_command(list(words))
            out, err = capsys.readouterr()
            return code, out, err

        return call

    def test_the_list_has_them_in_a_group_of_their_own(self, phalanx):
        out = phalanx("attack", "list")[1]
        by_robots, on_missions = out.split("\non missions")
        assert by_robots.startswith("by robots")
        for name, kind in ON_MISSIONS.items():
            assert f"\n{name} " in on_missions
            assert f"{kind.against}: {kind.does}" in on_missions
            assert kind.stopped_by in on_missions

    def test_json_has_the_same_and_robots_attacks_as_ever(self, phalanx):
        told = json.loads(phalanx("attack", "list", "--json")[1])
        assert all({"name", "does", "stopped_by", "verdicts"} <= row.keys() for row in told["attacks"])
        assert [(row["name"], row["against"], row["verdicts"]) for row in told["missions"]] == [
            (name, kind.against, dict(kind.verdicts)) for name, kind in ON_MISSIONS.items()
        ]
        run = json.loads(phalanx("attack", "run", "replay-day", "--json")[1])
        assert (run["attack"], run["defence"], run["declared"], run["kept"]) == (
            "replay-day",
            "hardened",
            "stopped",
            True,
        )
        assert run["attacked"]["refused"] == "outside_window"
        assert run["honest"] is None, "nothing was ordered"
        guess = json.loads(phalanx("attack", "run", "guess-gate", "--defence", "paper", "--json")[1])
        assert guess["attacked"]["read"] == guess["harm"] == 3

    def test_run_says_what_was_seen(self, phalanx):
        code, out, _ = phalanx("attack", "run", "move-code", "--defence", "none")
        assert code == 0
        assert "none, declared outcome: bites: as declared" in out
        assert "pick (WRONG)" in out
        code, out, _ = phalanx("attack", "run", "replay-day")
        assert code == 0
        assert "refused the mission: outside_window" in out

    def test_a_verdict_that_is_not_kept_ends_with_1(self, phalanx):
        code, out, _ = phalanx("attack", "run", "forge-graph:unchecked=1")
        assert code == 1
        assert "NOT AS DECLARED" in out
        assert "hand_over (WRONG)" in out

    @pytest.mark.parametrize(
        "words, complaint, hint",
        [
            (["flip-bits"], "no attack 'flip-bits'", "did you mean flip-bit?"),
            (["move-code:robot=3"], "move-code with robot", "one robot"),
            (["move-code", "--duration", "3"], "move-code with --duration", "one robot"),
            (["move-code:far=3"], "attack move-code has no option 'far'", "at, unchecked"),
            (["move-code:unchecked=yes"], "option unchecked of attack move-code is 'yes'", "0 or 1"),
            (["move-code:at=5000"], "move-code at 5000 s", "0 to 3600 s"),
            (["move-code", "--seed", "-1"], "seed -1", "0 or more"),
            (["flip-bit:bit=1e9"], "bit 1e+09 of a mission", "0 to "),
            (["guess-graph:at=3"], "attack guess-graph has no option 'at'", "none"),
        ],
    )
    def test_misuse_is_one_line_and_a_hint(self, phalanx, words, complaint, hint):
        code, out, err = phalanx("attack", "run", *words)
        assert (code, out) == (2, "")
        error, hinted = err.strip().splitlines()[-2:]
        assert complaint in error
        assert hint in hinted
