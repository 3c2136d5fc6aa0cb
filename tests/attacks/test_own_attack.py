"""The records of all attacks, and an attack of one's own: the page's example is run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from phalanx.attacks import Attack, own_attack
from phalanx.attacks.missions.between import Between
from phalanx.errors import UsageError
from phalanx.lab.cracking.guesses import Guess
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.adversary.mission_cheat import MissionCheat
from phalanx.robot.adversary.registry import attacks
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "attacks.md"
KINDS = {"flock": Liar, "errand": Between, "file": Guess, "team": MissionCheat, "protocol": Liar}


class ShoveAside(Liar):
    """Shoves others aside.

    For ever.
    """


@pytest.mark.parametrize("name", attacks())
def test_every_record_names_a_class_that_can_carry_it_out_where_it_is_tried(name):
    attack = attacks()[name]
    assert issubclass(attack.kind, KINDS[attack.scene])
    assert attack.kind.scene == attack.scene
    assert attack.does
    assert attack.stopped_by


def test_a_class_says_of_itself_what_the_record_needs():
    attack = own_attack(ShoveAside)
    assert (attack.name, attack.does, attack.scene) == ("shove-aside", "Shoves others aside", "flock")
    assert attack.kind is ShoveAside
    assert own_attack(attack) is attack


@pytest.mark.parametrize("thing", [dict, ShoveAside.lies, "hijack"])
def test_what_is_no_attack_is_refused(thing):
    with pytest.raises(UsageError, match="is not an attack"):
        own_attack(thing)


def test_its_options_are_checked_as_those_of_the_library_are():
    own = Attack("shove", ShoveAside)
    with pytest.raises(UsageError, match="attack shove has no option 'far'"):
        AttackSpec(name="shove", own=own, options={"far": 3.0})
    assert Scenario(attacks=(AttackSpec(name="shove", own=own),)).attacks[0].attack is own


def test_the_example_of_the_page_is_stopped_in_time():
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert child.returncode == 0, child.stderr
    told = re.search(r"'attack': 'brake', 'first_deviation_s': ([0-9.]+), 'safe_mode_s': ([0-9.]+)", child.stdout)
    began_s, stopped_s = map(float, told.groups())
    assert 10.0 <= began_s < stopped_s <= began_s + 10.251


def test_who_would_wait_for_ever_to_be_called_out_of_turn_is_told():
    class Shout(Liar):
        def on_wake(self, now_ms):
            return []

    with pytest.raises(UsageError, match="Shout has on_wake but no period_ms"):
        own_attack(Shout)
    Shout.period_ms = 100
    assert own_attack(Shout).name == "shout"
