"""`phalanx link` as people run it: beside a server of its own, and against one that says what it likes."""

from __future__ import annotations

import asyncio
import json
import re
import time

import pytest

from conftest import child, run
from phalanx.cli.link import _find
from phalanx.errors import Unavailable, UsageError
from phalanx.io import Client, Server

pytestmark = pytest.mark.waits


class TestConnect:
    def test_two_robots_of_one_name_are_told_apart_by_address_only(self):
        swarm = [{"address": "A1", "name": "Ada"}, {"address": "A2", "name": "ADA"}, {"address": "ADA", "name": "Bo"}]
        assert _find(swarm, "ada")["address"] == "ADA", "an address comes first"
        with pytest.raises(UsageError, match="2 robots are called Ada"):
            _find(swarm[:2], "Ada")
        with pytest.raises(Unavailable, match="no robot None"):
            _find([{"address": "A1", "name": None}], "None")


class TestLinkServe:
    def test_it_echoes(self):
        with child("link", "serve", "--events") as serve:
            ready = serve.wait_for("ready")
            with child("link", "connect", ready["qr_url"], "--watch") as watch:
                time.sleep(1.5)
                done = run("link", "connect", ready["qr_url"], "--timeout", "3")
                assert "not a list of robots" in done.stderr
                assert serve.wait_for("request")["request"] == 0
                assert watch.stop() == 0
            assert serve.stop() == 0

    def test_what_visitors_say_does_not_command_the_terminal_nor_end_the_server(self):
        with child("link", "serve") as serve:
            deadline = time.monotonic() + 20
            while not serve.out:
                assert time.monotonic() < deadline
                time.sleep(0.05)
            url = re.search(r"phalanx:#\S+", serve.out[0]).group()

            async def attack():
                async with Client(url) as client:
                    for payload in ("\x1b]0;owned\x07", "\ud800", "a\nb", "\u202eabc"):
                        await client.command("AB", "x", payload)
                    assert (await client.request(7))["request"] == 7

            asyncio.run(attack())
            assert serve.stop() == 0
            text = "\n".join(serve.out)
            assert "?]0;owned?" in text
            assert not set(text) & set("\x1b\x07\u202e")


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
        async with Server(broker.gateway, broker_for_visitors=broker.websocket) as server:
            server.on_request(0)(lambda request: robots)
            await server.wait_connected(10)
            url = server.qr().for_page("phalanx:")
            done = await asyncio.to_thread(run, "link", "connect", url)
            assert done.returncode == 0, done.stderr
            assert "\x1b" not in done.stdout
            done = await asyncio.to_thread(run, "link", "connect", url, "--json")
            assert all(isinstance(robot["address"], str) for robot in json.loads(done.stdout)["robots"])
