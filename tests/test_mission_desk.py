"""The operator's desk for missions: read, compiled, audited and sent by requests of operators."""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import replace
from operator import attrgetter

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from commands import called
from mission_swarms import SMALL, THROUGH, Silent, plain_of
from phalanx.cli.mission.files import read_plain
from phalanx.config.builtin import built_in
from phalanx.errors import UsageError
from phalanx.gateway.missions.desk import TEXT_MAX_BYTES, MissionDesk, _read, parse_profile, requests_of
from phalanx.mission import Profile, plain_mission
from phalanx.mission.authoring.document import mission_to_yaml
from waiting import eventually


@pytest.fixture
async def desk():
    swarm = Silent()
    acts = requests_of(MissionDesk(swarm))

    async def ask(what: str, words=None):
        return await acts[f"mission_{what}"](words or {})

    ask.swarm = swarm
    return ask


async def compiled(desk, text=THROUGH, profile="sealed"):
    assert await desk("compile", {"mission": text, "profile": profile}) == {}
    deadline = time.monotonic() + 30
    while (job := await desk("job"))["state"] == "compiling":
        assert time.monotonic() < deadline
        await asyncio.sleep(0.05)
    return job


class TestDesk:
    async def test_what_robots_cannot_sense_is_refused_before_it_is_compiled(self, desk):
        job = await compiled(desk, THROUGH.replace("{doorway: [5.0, 3.0], facing: 90}, width: 1.2", "{sensor: red}"))
        assert (job["state"], "requires the reading 'red'" in job["error"]) == ("failed", True)
        assert "--" not in job["hint"], "there is no command line in a browser"
        assert (await compiled(desk))["state"] == "compiled"

    async def test_the_building_shows_its_walls_and_landmarks(self, desk):
        world = await desk("world")
        assert (world["name"], world["bounds"]) == ("two rooms", [0, 0, 8, 6])
        assert len(world["walls"]) == 6
        (door,) = [site for site in world["sites"] if site["type"] == "doorway"]
        assert door["see"] == {"doorway": [5.0, 3.0], "facing": 90.0}
        assert door["width"] == 1.2

    async def test_what_the_building_shows_compiles_and_no_landmark_is_missed(self, desk):
        world = await desk("world")
        nodes = {"start": {"start": True, "see": {"position": world["start"]}}}
        nodes |= {f"n{i}": {"see": site["see"]} for i, site in enumerate(world["sites"])}
        ways = [["start", f"n{i}"] for i in range(len(world["sites"]))]
        job = await compiled(desk, json.dumps({"mission": "all", "nodes": nodes, "ways": ways}))
        assert job["state"] == "compiled"
        assert job["unseen"] == []
        assert job["nodes"] == len(nodes) > 3

    async def test_compile_audit_send_and_the_robots_begin(self, desk):
        assert await desk("job") == {"state": "none"}
        job = await compiled(desk)
        assert (job["nodes"], job["profile"], job["unseen"]) == (2, "sealed", [])
        start, door = job["audit"]["nodes"]
        assert start["out_of_reach"]
        assert 1 < door["candidates"] < 10_000
        assert door["core_s"] > door["gpu_s"] > 0
        assert "without the start key" in job["audit"]["problems"][0]
        assert await desk("send", {"id": job["id"]}) == {}
        number, run = desk.swarm.sent[-1]
        assert (number, run.robots) == (1, 2)
        assert run.parts[0].mission.header.mission_id.hex() == job["id"]
        assert desk.swarm.progress().name == "through"
        assert (await desk("send", {"id": job["id"]}))["error"] == "this robot has started this mission before"

    async def test_a_mission_of_another_profile_is_audited_as_such(self, desk):
        job = await compiled(desk, profile="paper")
        assert job["profile"] == "paper"
        assert not job["audit"]["nodes"][0]["out_of_reach"]

    async def test_the_newest_mission_takes_the_place_of_the_one_before(self, desk):
        slow = THROUGH.replace("kdf_log2_n: 4", "kdf_log2_n: 15")
        for text in (slow, slow, THROUGH):
            await desk("compile", {"mission": text, "profile": "sealed"})
        job = await compiled(desk, THROUGH.replace("through", "newest"))
        assert job["name"] == "newest"
        await desk("compile", {"mission": slow, "profile": "sealed"})
        assert (await desk("send", {"id": job["id"]}))["error"] == "no such mission is compiled"

    @pytest.mark.alone
    async def test_who_ends_the_gateway_does_not_wait_for_a_mission_of_minutes(self):
        see = ", ".join(f"{{position: [1.5, {k / 100}]}}" for k in range(250))
        slow = THROUGH.replace("{position: [1.5, 3.0]}", f"[{see}]").replace("kdf_log2_n: 4", "kdf_log2_n: 15")
        desk = MissionDesk(Silent())
        desk.compile(slow, Profile.SEALED)
        await eventually(lambda: desk.job().get("done", 0) > 2)
        assert desk.job()["of"] == 251
        began = time.monotonic()
        desk.stop()
        await asyncio.gather(*desk._tasks)
        assert time.monotonic() - began < 3
        assert desk.job()["state"] == "compiling"

    async def test_what_is_wrong_with_a_mission_is_said_in_a_line_with_a_hint(self, desk):
        for text, error in (
            ("mission: x\nnodes: {a: {see: {doorway: [1]}}}", "mission:2: node a: doorway has 1 numbers"),
            ("mission: x\nnodes: {a: {see: {position: [1, 1]}}}", "no node is marked as a start"),
            (THROUGH.replace("position: [1.5, 3.0]", "position: [5, 1]"), "no robot can stand at 'start'"),
            ("{", "mission:1: not YAML"),
        ):
            job = await compiled(desk, text)
            assert job["state"] == "failed"
            assert error in job["error"], job
        assert (await desk("send", {"id": "00" * 16}))["error"] == "no such mission is compiled"

    async def test_a_landmark_that_the_building_does_not_have_is_told(self, desk):
        job = await compiled(desk, THROUGH.replace("doorway: [5.0, 3.0]", "doorway: [5.0, 2.0]"))
        assert job["unseen"] == ["door"]

    @pytest.mark.parametrize("name", ["office", "delivery", "inspection"])
    async def test_a_mission_that_is_read_and_written_again_is_the_same(self, desk, name):
        text = built_in("missions")[name].read_text()
        told = await desk("read", {"mission": text})
        again = {
            "mission": told["name"],
            **told["rest"],
            "nodes": {node["name"]: node["words"] for node in told["nodes"]},
            "ways": [
                {"from": way["from"], "to": way["to"], **({"both": True} if way["both"] else {}), **way["rest"]}
                for way in told["ways"]
            ],
        }
        mine, theirs = plain_of(json.dumps(again)), read_plain(name)
        assert mine == theirs

    @pytest.mark.parametrize("name", built_in("missions"))
    def test_the_words_of_a_mission_describe_it(self, name):
        mission = read_plain(name)
        again = plain_mission(mission_to_yaml(mission))
        by_ends = attrgetter("source", "target")
        assert replace(again, ways=sorted(again.ways, key=by_ends)) == replace(
            mission, ways=sorted(mission.ways, key=by_ends)
        )

    async def test_the_mission_that_runs_can_be_read_back(self, desk):
        assert await desk("running") == {}
        job = await compiled(desk)
        assert await desk("running") == {}, "it was not sent"
        await desk("send", {"id": job["id"]})
        told = await desk("running")
        assert [(node["name"], node["at"]) for node in told["nodes"]] == [("start", [1.5, 3]), ("door", [5, 3])]
        nodes = {node["name"]: node["words"] for node in told["nodes"]}
        again = {"mission": told["name"], **told["rest"], "nodes": nodes, "ways": [["start", "door"]]}
        assert plain_of(json.dumps(again)) == plain_of()

    async def test_too_much_is_refused_before_it_is_read(self, desk):
        answer = await desk("read", {"mission": "x" * (TEXT_MAX_BYTES + 1)})
        assert answer["hint"] == f"at most {TEXT_MAX_BYTES} from this page"
        laughs = "ways: [" + ", ".join(["*a"] * 101) + "]"
        answer = await desk("read", {"mission": f"{THROUGH}{laughs}"})
        assert answer["error"] == "a mission that repeats itself too often"
        see = ", ".join(f"{{position: [{k}, 1]}}" for k in range(250))
        nodes = ", ".join(f"n{i}: {{see: *s}}" for i in range(1, 21))
        job = await compiled(desk, f"mission: many\nnodes: {{n0: {{start: true, see: &s [{see}]}}, {nodes}}}")
        assert "5250 ways" in job["error"]

    async def test_what_is_wrong_with_nodes_is_told_as_the_command_tells_it(self, desk, tmp_path):
        alone = "mission: alone\nnodes: {start: {start: true, see: {position: [1.5, 3.0]}}}"
        for text, name, problem in (
            (THROUGH.partition("ways:")[0], "door", "unreachable from any start"),
            (alone, "start", "the only node"),
        ):
            job = await compiled(desk, text)
            (found,) = [row["problems"] for row in job["audit"]["nodes"] if row["name"] == name]
            assert problem in found[0]
            (tmp_path / "mission.yaml").write_text(text)
            (tmp_path / "small.yaml").write_text(SMALL)
            files = str(tmp_path / "mission.yaml"), "--map", str(tmp_path / "small.yaml")
            told = json.loads(called("mission", "audit", *files, "--json").stdout)
            assert json.loads(json.dumps(job["audit"] | {"rates": job["rates"], "trial": None})) == told

    async def test_garbage_is_answered_with_a_line_and_nothing_breaks(self, desk, caplog):
        for what in ("read", "compile", "send"):
            for words in ({}, {"mission": 3}, {"id": {}}, {"mission": "x", "profile": []}):
                assert (await desk(what, words))["error"], (what, words)
        assert not caplog.records

    @pytest.mark.parametrize(
        "text",
        [
            "mission: x\nnodes: 2026-01-01",
            "mission: .nan\nnodes: {a: {start: true, see: {position: [.nan, 1]}}}",
            "mission: x\nnodes: {a: {start: true, see: {position: [1, 1]}, do: {lift: {h: .nan}}}}",
            "mission: x\nnodes: {? [1, 2] : {start: true}}",
            "mission: x\nnodes: {1: {start: true, see: {position: [1, 1]}}}\nways: [[1, 1]]",
            "mission: x\nnodes: {2026-01-01: {start: true, see: {position: [1, 1]}}}\nways: null",
            "a: &a [*a]",
            "mission: &x [*x]\nnodes: *x",
        ],
    )
    async def test_yaml_that_is_no_mission_is_said_to_be_none(self, desk, text):
        assert (await desk("read", {"mission": text}))["error"]
        assert (await compiled(desk, text))["state"] == "failed"

    @settings(max_examples=50, deadline=None)
    @given(
        st.recursive(
            st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
            lambda inner: (
                st.lists(inner, max_size=4)
                | st.dictionaries(
                    st.sampled_from(["mission", "nodes", "ways", "see", "do", "from", "to", "start", "a"]),
                    inner,
                    max_size=4,
                )
            ),
            max_leaves=12,
        )
    )
    def test_whatever_a_mission_says_reading_it_gives_json_or_a_usage_error(self, words):
        try:
            told = _read(yaml.safe_dump(words))
        except UsageError:
            return
        json.dumps(told, allow_nan=False)

    def test_profiles_have_names(self):
        assert parse_profile("sealed") is Profile.SEALED
        for word in ("open", "", 3, None, [], "SEALED "):
            with pytest.raises(UsageError):
                parse_profile(word)
