"""The page alone suffices to write a decoder: one that imports nothing of ours reads what the author wrote."""

from __future__ import annotations

import ast
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from cryptography.exceptions import InvalidSignature

import second_decoder as second
from phalanx.cli.mission.files import read_plain
from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Landmark,
    Mission,
    Position,
    Profile,
    Sensor,
    Time,
    build,
    plain_mission,
)
from phalanx.mission.authoring.compiling import direction_of
from phalanx.mission.file.records import FINAL, JOIN, START
from phalanx.mission.observable import sector_of
from worlds import BOTH, CHEAP, EVERYTHING, corridor, draws, explored, fork, walker_of

ROWS = json.loads((Path(__file__).parents[2] / "vectors" / "mission.json").read_text())


def world(mission: Mission, messages: tuple[bytes, ...] = ()) -> second.World:
    """All that a mission is made of, and a little more."""
    things = [thing for node in mission.nodes for alias in node.see for thing in alias]
    acts = [do for do in [*(node.do for node in mission.nodes), *(way.do for way in mission.ways)] if do]
    acts += [Action("idle"), *(thing for thing in things if isinstance(thing, Action))]
    return second.World(
        tuple(_thing(thing) for thing in things if isinstance(thing, Landmark | Position)),
        (b"green", *dict.fromkeys(thing.value for thing in things if isinstance(thing, Sensor))),
        tuple(dict.fromkeys((act.name, act.args) for act in acts)),
        tuple(thing.t_s for thing in things if isinstance(thing, Time)),
        messages,
    )


def _thing(thing: Landmark | Position) -> second.Thing:
    if isinstance(thing, Position):
        return second.Thing("position", thing.x_m, thing.y_m)
    return second.Thing(thing.type, thing.x_m, thing.y_m, thing.orientation_rad, thing.area_m2, thing.text)


def decoded(mission: Mission, profile: Profile, **options) -> list[second.Decoder]:
    """What the second decoder reads of each part; messages of other parts have come."""
    halves = build(mission, BuildOptions(profile=profile, **options), draws())
    said = tuple(message for half in halves for message in half.key.messages.values())
    parts: list[second.Decoder] = []
    for _ in range(4):  # what one part says, another may wait for, and that for the first
        heard = said + tuple(message for part in parts for node in part.nodes.values() for message in node.sends)
        heard = tuple(dict.fromkeys(heard))
        parts = [second.Decoder(half.mission.encode(), half.key.encode(), world(mission, heard)) for half in halves]
    return parts


def check(mission: Mission, profile: Profile, parts: list[second.Decoder]) -> None:
    """What was read is what the author wrote, node by node."""
    for name, part in zip(mission.parts, parts, strict=True):
        plain = [node for node in mission.nodes if node.part == name]
        number = {node.name: i for i, node in enumerate(plain)}
        assert part.nodes.keys() == set(range(len(plain)))
        for i, node in enumerate(plain):
            read = part.nodes[i]
            assert read.flags == START * node.start | FINAL * node.final | JOIN * node.join
            assert (read.timeout_s, read.reach_dm) == (node.timeout_s, math.ceil(node.within_m * 10))
            assert read.name == (None if profile is Profile.PAPER else node.name)
            do = next((thing for thing in node.see[read.alias % len(node.see)] if isinstance(thing, Action)), node.do)
            assert (read.do and (read.do[0], dict(read.do[1]))) == (do and (do.name, dict(do.args)))
            assert len(read.sends) == len(node.send)
            assert (read.place is None) == (node.place is None)
            see = node.see[read.alias % len(node.see)]
            place = next((thing for thing in see if isinstance(thing, Landmark | Position)), None)
            if place is not None:
                middle = node.place if profile is Profile.SEALED else (place.x_m, place.y_m)
                assert read.place == pytest.approx(middle, abs=0.6e-3), "to the mm"
            if isinstance(place, Landmark) and place.orientation_rad is not None:
                whole = math.pi if place.type == "doorway" else math.tau
                assert abs(math.remainder(read.facing - place.orientation_rad, whole)) <= 0.6e-4
            ways = sorted((way for way in mission.ways if way.source == node.name), key=lambda way: number[way.target])
            assert [way.target for way in read.ways] == [number[way.target] for way in ways]
            for way, told in zip(ways, read.ways, strict=True):
                assert told.do == (way.do and (way.do.name, way.do.args))
                source = node.place if profile is Profile.SEALED else place and (place.x_m, place.y_m)
                towards = direction_of(way, source, plain[number[way.target]].place)
                sectors = part.file.sectors
                assert told.sector == (None if way.do or towards is None else sector_of(towards, sectors))


def odd() -> Mission:
    """What the page once left out: chains over several aliases, ways without a direction, several of a kind."""
    draft = Draft("odd", coding=replace(CHEAP, window_ms=2500))
    draft.node("start", Position(0.1, -0.3), (Sensor(b"a"), Sensor(b"b"), Sensor(b"c")), start=True, send=("x", "y"))
    draft.node("left", Landmark("concave_left", 2.03, 1.0, -3.1), Landmark("concave_right", 2.03, 1.0, 1.6))
    draft.node("timed", (Landmark("room", 4.0, 2.2, area_m2=7.7), Time(1234.5)), wait=("x", "y"))
    draft.node("sensed", Sensor(b"red"), do=Action("say", (("to", "all"), ("n", -1.5))))
    draft.node("did", (Position(7.0, 3.0), Action("stop")))
    draft.node("end", Landmark("qr", 9.0, 3.0, 0.0, text="Grüße"), join=True, final=True)
    for source, target in (
        ("start", "left"),
        ("left", "timed"),
        ("timed", "sensed"),
        ("sensed", "did"),
        ("did", "end"),
    ):
        draft.way(source, target)
    draft.way("timed", "end", do=Action("lift", (("floor", 2.0),)))
    return draft.mission()


def chained() -> Mission:
    plain = odd()
    nodes = tuple(replace(node, chained=node.name in ("timed", "did")) for node in plain.nodes)
    # A message of the paper profile is made of the one thing sensed.
    start = replace(nodes[0], see=nodes[0].see[:1])
    return replace(plain, nodes=(start, *nodes[1:]))


def cheap(mission: Mission) -> Mission:
    return replace(mission, coding=replace(mission.coding or CHEAP, kdf_log2_n=1, kdf_r=1))


MISSIONS = {
    "everything": plain_mission(yaml.safe_load(EVERYTHING)),
    "office": read_plain("office"),
    "delivery": read_plain("delivery"),
    "inspection": read_plain("inspection"),
    "odd": chained(),
    "corridor": corridor(),
    "fork": fork().mission(),
}


@pytest.mark.parametrize("profile", BOTH)
@pytest.mark.parametrize("name", MISSIONS)
def test_it_reads_what_the_author_wrote(name, profile):
    mission = cheap(MISSIONS[name])
    check(mission, profile, decoded(mission, profile))


def test_it_reads_open_starts_robots_rounded_offsets_and_joins():
    mission = cheap(odd())
    check(mission, Profile.SEALED, decoded(mission, Profile.SEALED, open_start=True, robots=(3, 7), offset_mm=1))
    (one,) = build(mission, BuildOptions(open_start=True, robots=(7, 3)), draws())
    read = second.Decoder(one.mission.encode(), None, world(mission))
    assert read.file.robots == (3, 7)
    assert len(read.nodes) == len(mission.nodes)


@pytest.mark.parametrize("profile", BOTH)
def test_ours_reads_the_same(profile):
    mission = cheap(MISSIONS["office"])
    (one,) = build(mission, BuildOptions(profile=profile), draws())
    (part,) = decoded(mission, profile)
    ours = {
        outcome.decoded.node: outcome.decoded for _, outcome in explored(mission, walker_of(one)) if outcome.decoded
    }
    assert ours.keys() == part.nodes.keys()
    for i, opened in ours.items():
        read = part.nodes[i]
        assert (opened.name or None, [way.target for way in opened.ways]) == (read.name, [w.target for w in read.ways])
        if opened.alias == read.alias:
            assert (opened.place_m, opened.sends) == (read.place, read.sends)
            told = [way.sector * math.tau / part.file.sectors for way in read.ways]
            away = [
                math.remainder(way.direction_rad - there, math.tau)
                for way, there in zip(opened.ways, told, strict=True)
            ]
            assert away == pytest.approx([0.0] * len(away), abs=1e-9)
    assert sum(opened.alias == part.nodes[i].alias for i, opened in ours.items()) > 20


@pytest.mark.parametrize("case", ROWS["canonical"], ids=[row["name"] for row in ROWS["canonical"]])
def test_it_hashes_what_the_vectors_hash(case):
    place = b""
    if "landmark" in case:
        words = case["landmark"]
        cell = words["x"], words["y"], words.get("bin", -1), words.get("area", -1)
        place = second.place_bytes(cell, 1 + second.TYPES.index(words["type"]), words.get("text"))
    if "position" in case:
        place = second.place_bytes((*case["position"], -1, -1), second.POSITION, None)
    do = (case["action"][0], tuple(case["action"][1].items())) if "action" in case else None
    raw = second.canonical(
        place,
        tuple(word.encode() for word in case.get("sensors", [])),
        do,
        case.get("window"),
        tuple(bytes.fromhex(message) for message in case.get("messages_hex", [])),
        bytes.fromhex(case["previous_hex"]) if "previous_hex" in case else None,
    )
    raw += second.observable(8, second.struct.pack("<HH", *case["direction"])) if "direction" in case else b""
    assert (raw.hex(), second.sha3(raw).hex()) == (case["canonical_hex"], case["hash_hex"])


@pytest.mark.parametrize("case", ROWS["cases"], ids=[row["name"] for row in ROWS["cases"]])
def test_it_reads_and_refuses_the_shared_files(case):
    raw, key = bytes.fromhex(case["file_hex"]), bytes.fromhex(case.get("key_hex", "")) or None
    things = (second.Thing("position", 3.0, 1.5), second.Thing("doorway", 9.03, 12.0, 0.3))
    if case["expect"] == "MalformedMission":
        with pytest.raises(ValueError):
            second.File(raw)
    elif case["expect"] == "NotAuthentic":
        with pytest.raises(InvalidSignature):
            second.File(raw)
    elif case["expect"] == "ok":
        read = second.Decoder(raw, key, second.World(things))
        assert len(read.nodes) == len(case["walk"])
        for node, told in zip(read.nodes.values(), case["walk"], strict=True):
            if told["landmark"] is None:
                assert node.place == (told["x_m"], told["y_m"])
            else:
                assert node.place == pytest.approx((9.03, 12.0))
                assert node.facing == pytest.approx(0.3, abs=1e-4)
                assert len(node.sends) == 1


@pytest.mark.parametrize("profile", BOTH)
def test_it_explains_every_byte(profile):
    """Wherever a bit is turned, something does not decode, or is refused."""
    mission = cheap(fork().mission())
    (one,) = build(mission, BuildOptions(profile=profile), draws())
    raw, key = one.mission.encode(), one.key.encode()
    whole = second.Decoder(raw, key, world(mission)).nodes
    for at in range(0, len(raw), 5):
        altered = bytearray(raw)
        altered[at] ^= 1
        try:
            nodes = second.Decoder(bytes(altered), key, world(mission)).nodes
        except Exception:
            continue
        assert len(nodes) < len(whole), at


def test_nothing_of_ours_is_imported_by_it():
    tree = ast.parse(Path(second.__file__).read_text())
    names = {alias.name for each in ast.walk(tree) if isinstance(each, ast.Import) for alias in each.names}
    names |= {str(each.module) for each in ast.walk(tree) if isinstance(each, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} == {
        "__future__", "cryptography", "dataclasses", "hashlib", "hmac", "itertools", "math", "struct",
    }  # fmt: skip
