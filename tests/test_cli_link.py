"""`phalanx link` as people run it, against a server that says what it likes."""

from __future__ import annotations

import asyncio
import json

import pytest

from commands import child, run
from phalanx.cli.link import _find
from phalanx.errors import Unavailable, UsageError
from phalanx.net import Server
from session_endpoint import Endpoint

pytestmark = pytest.mark.waits


class TestConnect:
    def test_two_robots_of_one_name_are_told_apart_by_address_only(self):
        swarm = [{"address": "A1", "name": "Ada"}, {"address": "A2", "name": "ADA"}, {"address": "ADA", "name": "Bo"}]
        assert _find(swarm, "ada")["address"] == "ADA", "an address comes first"
        with pytest.raises(UsageError, match="2 robots are called Ada"):
            _find(swarm[:2], "Ada")
        with pytest.raises(Unavailable, match="no robot None"):
            _find([{"address": "A1", "name": None}], "None")


class TestHostileSwarms:
    @pytest.mark.parametrize(
        "robots",
        [
            [{"address": "A", "lh2_position": {"x": "no"}, "battery": "full", "status": 99, "name": ["x"]}],
            [
                {"address": "A\x1b[2J"},
                {"address": "A", "name": "\x1b]0;x\x07", "lh2_position": {"x": 10**400, "y": None}},
            ],
            [{"address": 7}, None, "A", {"name": "no address"}, {"address": "B", "battery": True, "status": True}],
        ],
        ids=["wrong types", "escapes", "not robots"],
    )
    async def test_a_list_of_robots_is_shown_whatever_is_in_it(self, broker, robots):
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            server.on_request(0)(lambda request: robots)
            await server.wait_connected(10)
            url = server.qr().for_page("phalanx:")
            done = await asyncio.to_thread(run, "link", "connect", url)
            assert done.returncode == 0, done.stderr
            assert "\x1b" not in done.stdout
            done = await asyncio.to_thread(run, "link", "connect", url, "--json")
            assert all(isinstance(robot["address"], str) for robot in json.loads(done.stdout)["robots"])

    async def test_what_a_swarm_tells_everybody_is_printed_as_it_comes_and_commands_no_terminal(self, broker):
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            await server.wait_connected(10)
            with child("link", "connect", server.qr().for_page("phalanx:"), "--watch") as watch:
                while not watch.out:
                    await server.notify({"said": "\x1b]0;owned\x07"})
                    await asyncio.sleep(0.1)
                assert await asyncio.to_thread(watch.stop) == 0
            assert json.loads(watch.out[0]) == {"said": "\x1b]0;owned\x07"}
            assert "\x1b" not in watch.out[0]


class TestSessions:
    async def test_a_session_s_link_lists_drives_and_keeps_the_visitor(self, tmp_path):
        async with Endpoint() as swarm:
            url, keep = swarm.ticket(uses=1, name="Ada"), str(tmp_path / "ada")

            async def connect(*words):
                return await asyncio.to_thread(run, "link", "connect", url, "--keep", keep, *words)

            listed = await connect("--json")
            assert [each["address"] for each in json.loads(listed.stdout)["robots"]] == ["A1", "B2"], listed.stderr
            drove = await connect("--drive", "robot a1", "--left", "40", "--for", "0.5", "--json")
            assert json.loads(drove.stdout)["address"] == "A1", drove.stderr
            assert {each.visitor for each in swarm.commands} == {1}, "the ticket admits once: it was the same visitor"
            assert json.loads(swarm.commands[0].payload)["left_y"] == 40
            assert swarm.commands[-1].is_stop
            swarm.operations.remove(1, swarm.now)
            out = await connect()
            assert out.returncode == 1
            assert "does not admit" in out.stderr

    async def test_what_a_ticket_does_not_allow_is_said_in_one_line(self):
        async with Endpoint() as swarm:
            url = swarm.ticket(robots=frozenset({"B2"}))
            done = await asyncio.to_thread(run, "link", "connect", url, "--drive", "A1")
            assert done.returncode == 1
            assert "phalanx: error: driving A1 was refused: not allowed" in done.stderr

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            (("http://x/#j=abc",), "not an invitation"),
            (("http://x/#j=abc", "--pin", "1234"), "a session link with a pin"),
            (("http://x/#v=1&pin=123456&broker=ws://x", "--name", "Ada"), "without a session"),
        ],
    )
    def test_what_does_not_fit_together_is_refused(self, words, said):
        done = run("link", "connect", *words)
        assert done.returncode == 2
        assert said in done.stderr
