"""Missions as YAML and as code: the same mission, and complaints that say where."""

from __future__ import annotations

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.cli.mission.files import read_plain
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.errors import UsageError
from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Landmark,
    Position,
    Profile,
    Sensor,
    Time,
    build,
    plain_mission,
)
from phalanx.mission.authoring.document import WrittenMission
from worlds import BOTH, EVERYTHING, built, cheap, draws


def test_yaml_and_code_are_two_ways_to_write_one_mission():
    draft = Draft(
        "everything",
        coding=CodingConfig(delta_mm=200, kdf_log2_n=1, kdf_r=1),
        area_m=(0, 0, 40, 40),
        repeatable=True,
        floor_plan="office_40x40",
    )
    draft.node("start", Position(3.0, 1.5), start=True)
    draft.node(
        "door",
        Landmark("doorway", 9, 12, math.pi / 2),
        do=Action("pick", (("from", "top"), ("shelf", 3))),
        within_m=2,
        width_m=2.0,
    )
    draft.node(
        "room",
        Landmark("room", 12.5, 3.5, None, 52.5),
        Landmark("room", 16, 3.5, None, 52.5),
        timeout_s=30,
        send=("lit",),
        within_m=1.0,  # what a file means that says nothing
    )
    draft.node("code", Landmark("qr", 1, 2, -math.pi / 2, None, "shelf 3"), do=Action("stop"), within_m=1.0)
    draft.node("noon", (Position(5, 5), Sensor(b"red"), Sensor(b"warm"), Time(1000)), wait=("go",), final=True)
    draft.way("start", "door", both=True)
    draft.way("door", "room", both=True)
    for target in ("code", "noon"):
        draft.way("room", target, direction_rad=math.radians(45))
    draft.way("code", "noon", do=Action("lift", (("floor", 2),)))
    assert plain_mission(yaml.safe_load(EVERYTHING)) == draft.mission()


@pytest.mark.parametrize(
    "change", ["do: {lamp: {on: 1}}", "do: {off: {level: 1}}", "do: {lamp: {~: 1}}", "do: {lamp: {1.5: 1}}"]
)
def test_a_name_that_yaml_takes_for_something_else_is_refused_and_not_encoded(change):
    text = "{mission: m, nodes: {start: {start: true, see: {position: [0, 0]}, %s}}}"
    with pytest.raises(UsageError, match="a name is read as") as caught:
        plain_mission(yaml.safe_load(text % change))
    assert '"on"' in caught.value.hint
    with pytest.raises(UsageError, match="nodes: a name is read as True"):
        plain_mission(yaml.safe_load("{mission: m, nodes: {yes: {start: true, see: {position: [0, 0]}}}}"))
    quoted = plain_mission(yaml.safe_load(text % 'do: {lamp: {"on": 1, 2: x}}'))
    assert quoted.nodes[0].do == Action("lamp", (("2", "x"), ("on", 1)))


def test_the_lamp_of_inspection_is_switched_on():
    assert Action("lamp", (("on", 1),)) in [node.do for node in read_plain("inspection").nodes]


@pytest.mark.parametrize("profile", BOTH)
def test_all_that_can_be_written_can_be_built(profile):
    mission = plain_mission(yaml.safe_load(EVERYTHING))
    if profile is Profile.PAPER:
        (one,) = build(mission, BuildOptions(profile=profile), draws())
        assert one.mission.header.coding.delta_mm == 200
    one = built(cheap(mission, profile), profile)
    assert set(one.key.messages) == {"go"}, "nobody in the mission sends it: the controller does"


@pytest.mark.parametrize(
    "change, says",
    [
        ({"mission": None}, "mission is missing"),
        ({"nodes": []}, "nodes is []"),
        ({"nodes": {}}, "0 nodes"),
        ({"colour": 1}, "unknown key 'colour'"),
        ({"area": [0, 0, 1]}, "area has 3 numbers"),
        ({"area": -2.0}, "area is -2.0"),
        ({"area": [5, 0, 1, 9]}, "area is [5.0, 0.0, 1.0, 9.0]"),
        ({"area": [0, 9, 1, 9]}, "area is [0.0, 9.0, 1.0, 9.0]"),
        ({"area": [0, 0, 1e9, 9]}, "area is [0.0, 0.0, 1000000000.0, 9.0]"),
        ({"coding": {"delta_mm": 0}}, "delta_mm is 0"),
        ({"coding": {"delta_mm": 1.5}}, "delta_mm is 1.5"),
        ({"coding": {"heading_bins": 25}}, "heading_bins is 25"),
        ({"ways": [["start"]]}, "way 1 has 1 ends"),
        ({"ways": [["start", "nowhere"]]}, "'nowhere', which is not a node"),
        ({"ways": [["start", "start"]]}, "a way leads from"),
        ({"ways": [{"from": "start", "to": "end", "direction": "north"}]}, "direction is 'north'"),
        ({"ways": [{"from": "start", "to": "end", "direction": 1e11}]}, "direction 17"),
        ({"ways": [{"from": "start", "to": "end", "do": {"lift": {"floor": 1e12}}}]}, "argument 'floor'"),
        ({"ways": [["start", "end"], ["end", "start"]]}, "a second way"),
        ({"roam": "yes"}, "roam is 'yes'"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused_with_the_place(change, says):
    words = {
        "mission": "m",
        "nodes": {
            "start": {"start": True, "see": {"position": [0, 0]}},
            "end": {"final": True, "see": {"doorway": [1, 0]}},
        },
        "ways": [["start", "end"]],
    }
    plain_mission(words)
    with pytest.raises(UsageError) as caught:
        plain_mission(words | change)
    assert says in str(caught.value)
    assert caught.value.hint


@pytest.mark.parametrize(
    "node, says",
    [
        ({"see": {"doorway": [1, 0], "room": [1, 0]}}, "doorway and room"),
        ({"see": {"doorway": [1, 0], "position": [1, 0]}}, "two places"),
        ({"see": {"doorway": [1]}}, "1 numbers"),
        ({"see": {"doorway": [1, float("nan")]}}, "is nan"),
        ({"see": {"facing": 3}}, "belong to a landmark"),
        ({"see": {"room": [1, 0], "area": -2.0}}, "a room with an area of -2.0 m2"),
        ({"see": {"room": [1, 0], "area": 0}}, "a room with an area of 0.0 m2"),
        ({"see": {"doorway": [1, 0], "area": 2}}, "a doorway with an area"),
        ({"see": {"doorway": [1, 0], "facing": 1e9}}, "a doorway at 1.0, 0.0"),
        ({"see": {"doorway": [1, 0]}, "width": -3}, "a width of -3.0 m"),
        ({"see": {"doorway": [1, 0]}, "width": 0}, "a width of 0.0 m"),
        ({"see": {"position": [1e7, 0]}}, "a position at 10000000.0, 0.0"),
        ({"see": {"time": -5}}, "a time of -5.0 s"),
        ({"see": {"action": {"lift": {"floor": float("nan")}}}}, "argument 'floor'"),
        ({"see": {"window": [1, 0]}}, "unknown key 'window'"),
        ({"see": {}}, "nothing to see"),
        ({}, "nothing to see"),
        ({"see": {"qr": [1, 0], "token": "1234"}}, "not a random token"),
        ({"see": {"qr": [1, 0], "text": "a", "token": "0" * 32}}, "not a random token"),
        ({"see": {"sensor": "red", "action": "a"}, "do": "b"}, "an action under see and under do"),
        ({"see": {"sensor": ["a", "b", "c", "d"]}}, "too many observables"),
        ({"see": {"sensor": [["a"]]}}, "sensor is ['a']"),
        ({"see": {"sensor": "a"}, "part": []}, "part is []"),
        ({"see": {"sensor": "a"}, "within_m": 26}, "within_m of node 'bad' is 26"),
        ({"see": {"sensor": "a"}, "timeout_s": 1e6}, "times out"),
        ({"see": {"sensor": "a"}, "timeout_s": -0.5}, "times out"),
        ({"see": {"sensor": "a"}, "within_m": -1}, "within_m of node 'bad' is -1"),
        ({"see": {"sensor": "a"}, "do": {"a": 1, "b": 2}}, "not an action"),
        ({"see": {"sensor": "a"}, "do": {"pick": {"x": [1]}}}, "pick: x is [1]"),
        ({"see": {"sensor": "a"}, "do": "x" * 300}, "as a name or value"),
        ({"see": {"sensor": "a"}, "do": {"go": {"far": 1e30}}}, "is 1e+30"),
        ({"see": {"sensor": "a"}, "send": ["a"] * 2}, "sent twice"),
        ({"see": {"sensor": "a"}, "wait": ["a", "b", "c", "d"]}, "waits for 4"),
        ({"see": {"sensor": "a"}, "send": "x", "wait": "x"}, "wait for each other"),
        ({"see": [{"sensor": "a"}] * 256}, "256 alternatives"),
        ([1], "node bad is [1]"),
        ("door", "node bad is 'door'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_node_that_makes_no_sense_is_refused_with_its_name(node, says):
    words = {"mission": "m", "nodes": {"start": {"start": True, "see": {"position": [0, 0]}}, "bad": node}}
    with pytest.raises(UsageError) as caught:
        plain_mission(words)
    assert says in str(caught.value)


def test_a_corner_without_a_hand_is_refused_with_the_words_to_write_instead():
    words = {"mission": "m", "nodes": {"old": {"start": True, "see": {"corner_concave": [1, 0], "facing": 0}}}}
    with pytest.raises(UsageError) as caught:
        plain_mission(words)
    assert str(caught.value) == "node old: corner_concave does not tell the end of its wall"
    assert caught.value.hint == "use concave_left or concave_right, as seen when facing the wall"
    for kind in ("concave_left", "concave_right"):
        words["nodes"]["old"]["see"] = {kind: [1, 0], "facing": 0}
        assert plain_mission(words).nodes[0].see == ((Landmark(kind, 1, 0, 0.0),),)


FILE = """\
mission: through
coding: {delta_mm: 400, kdf_log2_n: 4}
nodes:
  start: {start: true, see: {position: [1.5, 3.0]}}
  door:
    see:
      doorway: [5.0, 3.0]
      facing: 90
    within_m: 1.5
    final: true
ways:
  - [start, door]
"""


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("doorway:", "doorwa:", "7: node door: see has the unknown key 'doorwa'"),
        ("facing: 90", "facing: up", "8: node door: facing is 'up'"),
        ("within_m: 1.5", "within_m: x", "9: node door: within_m is 'x'"),
        ("within_m: 1.5", "within_m: 99", "9: within_m of node 'door' is 99.0"),
        ("within_m: 1.5", "width: -3", "9: node 'door' has a width of -3.0 m"),
        ("facing: 90", "area: -2.0", "7: node 'door' sees a doorway with an area"),
        ("coding:", "area: [1, 1, 0, 0]\ncoding:", "2: area is [1.0, 1.0, 0.0, 0.0]"),
        ("within_m: 1.5", "do: {pick: 1, put: 2}", "9: node door: not an action"),
        ("facing: 90", "position: [1, 1]", "6: two places in one node"),
        ("  door:", "  start-2: {see: {position: [a, 1]}}\n  door:", "5: node start-2: position is 'a'"),
        ("  door:", "  on:", "5: nodes: a name is read as True"),
        ("start: true, ", "", "3: no node is marked as a start"),
        ("mission: through\n", "", " mission is missing"),
        ("kdf_log2_n", "kdf", "2: coding has the unknown key 'kdf'"),
        ("kdf_log2_n: 4", "kdf_log2_n: 99", "2: kdf_log2_n is 99"),
        ("nodes:", "nodess:", "3: the file has the unknown key 'nodess'"),
        ("[start, door]", "[start, dor]", "12: a way has an end 'dor'"),
        ("[start, door]", "[start]", "12: way 1 has 1 ends"),
        ("  - [start, door]", "  - {from: start,\n     to: door, direction: n}", "13: way 1: direction is 'n'"),
        ("ways:", "ways:\n  - [start, door]", "13: a second way"),
        ("coding", "mission: 3\ncoding", "2: not YAML: key 'mission' occurs twice"),
        ("final: true", "final: [[", "12: not YAML"),
        ("final: true", "final: " + "[" * 1_000_000, "10: not YAML: nested too deep"),
        ("final: true", "do: &a [*a]", "10: not YAML"),
        ("final: true", "final: !!int ''", " not YAML"),
        ("final: true", "final: !!timestamp x", " not YAML"),
    ],
    ids=lambda value: value[:30],
)
def test_a_mistake_in_a_file_is_told_with_its_line(old, new, says):
    assert len(WrittenMission(FILE.encode(), "f.yaml").mission().nodes) == 2
    with pytest.raises(UsageError) as caught:
        WrittenMission(FILE.replace(old, new, 1).encode(), "f.yaml").mission()
    assert str(caught.value).startswith(f"f.yaml:{says}")
    assert caught.value.hint


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, len(FILE)), st.text("{}[]:-,&*!|>'\"%@#? \nabdorw:129e.~\xff", max_size=5)), max_size=5
    )
)
def test_a_file_with_other_characters_in_it_is_a_mission_or_told_with_its_name(changes):
    text = FILE
    for at, more in changes:
        text = text[:at] + more + text[at + len(more) :]
    try:
        WrittenMission(text.encode(), "f.yaml").mission()
    except UsageError as error:
        assert str(error).startswith("f.yaml:")


def test_a_bomb_of_aliases_in_a_file_is_told_at_once():
    lines = ["l0: &l0 [x]", *(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]" for i in range(1, 60))]
    with pytest.raises(UsageError, match="unknown key"):
        WrittenMission("\n".join(["mission: m", *lines]).encode(), "f.yaml").mission()


def test_a_bomb_of_aliases_is_refused_before_it_goes_off():
    bomb = ["lol"]
    for _ in range(60):
        bomb = [bomb] * 9
    for node in ({"see": {"sensor": bomb}}, {"see": bomb}, {"see": {"doorway": bomb}}, bomb):
        with pytest.raises(UsageError) as caught:
            plain_mission({"mission": "m", "nodes": {"start": node}})
        assert len(str(caught.value)) < 300


def test_a_mission_without_a_start_or_with_two_nodes_of_a_name_is_refused():
    draft = Draft("m")
    draft.node("a", Position(0, 0))
    with pytest.raises(UsageError, match="start"):
        draft.mission()
    draft.node("a", Position(1, 0), start=True)
    with pytest.raises(UsageError, match="two nodes are called 'a'"):
        draft.mission()


def test_parts_are_joined_by_messages_alone():
    draft = Draft("m")
    for part in "ab":
        draft.node(part, Position(0, 0), start=True, part=part)
    draft.way("a", "b")
    with pytest.raises(UsageError, match="joins two parts"):
        draft.mission()


@pytest.mark.parametrize(
    "options",
    [
        {"robots": (70_000,)},
        {"robots": tuple(range(300))},
        {"valid_from_s": 5, "valid_to_s": 5},
        {"valid_from_s": -1},
        {"open_start": True, "profile": Profile.PAPER},
    ],
    ids=str,
)
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(UsageError):
        BuildOptions(**options)


def test_what_one_profile_cannot_say_is_refused_with_the_other_as_a_hint():
    draft = Draft("m", roam=True)
    draft.node("a", Position(0, 0), start=True)
    with pytest.raises(UsageError, match="roam"):
        built(draft.mission(), Profile.SEALED)
    chain = Draft("m")
    chain.node("a", Position(0, 0), start=True, chained=True)
    chain.node("b", Position(1, 0), chained=True)
    chain.way("a", "b", both=True)
    with pytest.raises(UsageError, match="circle") as caught:
        built(chain.mission(), Profile.PAPER)
    assert "use the sealed profile" in caught.value.hint
    built(cheap(chain.mission(), Profile.SEALED), Profile.SEALED)


@pytest.mark.parametrize(
    "bad", [{"tolerance_m": -1}, {"kdf_tries": 0}, {"timeout_s": math.nan}, {"sigmas": 0.0}], ids=str
)
def test_a_bad_configuration_cannot_be_made(bad):
    with pytest.raises(UsageError):
        MissionConfig(**bad)


def test_a_kdf_that_would_eat_a_robots_memory_cannot_be_asked_for():
    with pytest.raises(UsageError, match="scrypt with N"):
        CodingConfig(kdf_log2_n=15, kdf_r=16)
