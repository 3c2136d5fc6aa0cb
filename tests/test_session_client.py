"""The client of sessions, over a real websocket."""

from __future__ import annotations

import asyncio
import json
import os
import stat
from collections import Counter

import pytest
from aiohttp import web
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phalanx.config.session import SessionConfig
from phalanx.errors import BadPayload, PeerError, Unavailable, UsageError
from phalanx.link.session import EndReason, Kind, Reason, Role, Secret
from phalanx.link.session.invitation import BadInvitation
from phalanx.net.session_client import Client, RequestRefused, SessionOver
from phalanx.net.session_connection import websocket_url
from phalanx.net.session_ways import WebsocketTransport
from session_endpoint import Endpoint
from waiting import eventually

pytestmark = pytest.mark.waits


class TestUrl:
    @pytest.mark.parametrize(
        ("url", "opens"),
        [
            ("http://10.0.0.7:8080/#j=x", "ws://10.0.0.7:8080/link"),
            ("https://swarm.example/#j=x", "wss://swarm.example/link"),
            ("http://[::1]:8080/#j=x", "ws://[::1]:8080/link"),
            (" http://pi.local/some/page?x#j=x\n", "ws://pi.local/link"),
        ],
    )
    def test_the_websocket_is_at_the_origin_of_the_page(self, url, opens):
        assert websocket_url(url) == opens

    @pytest.mark.parametrize("url", ["", "j=x", "ftp://a/#j=x", "http://#j=x", "http://u:p@a/#j=x", "http://a:x/#j=x"])
    def test_what_is_no_page_is_refused(self, url):
        with pytest.raises(BadInvitation):
            websocket_url(url)


class TestVisiting:
    async def test_a_visitor_lists_drives_sends_on_a_route_and_stops(self):
        async with Endpoint() as swarm, Client(swarm.url(), name="Ada") as client:
            assert client.is_joined
            assert (client.name, client.standing.role) == ("Ada", Role.DRIVE)
            assert [each["address"] for each in await client.robots()] == ["A1", "B2"]
            await client.drive("A1", 50, 60, for_s=0.5)
            await client.route("A1", [(100, 200), (300, 400)])
            await client.stop("A1")
            await eventually(lambda: sum(each.is_stop for each in swarm.commands) == 2)
            assert json.loads(swarm.commands[0].payload) == {"left_x": 0, "left_y": 50, "right_x": 0, "right_y": 60}
            assert [each.name for each in swarm.commands][-2:] == ["waypoints", "move_raw"]
            assert {each.robot for each in swarm.commands} == {"A1"}
            assert client.rejected == {}

    async def test_updates_come_in_order(self):
        async with Endpoint() as swarm:
            numbers = iter(range(1000))
            swarm.state = lambda: json.dumps({"seq": next(numbers)}).encode()
            async with Client(swarm.url()) as client:
                updates = client.updates()
                seen = [(await anext(updates))["seq"] for _ in range(5)]
                assert seen == list(range(seen[0], seen[0] + 5))

    async def test_one_record_is_sent_in_each_slot_while_a_robot_is_leased(self):
        async with Endpoint(config=SessionConfig(lease_ms=1000)) as swarm, Client(swarm.url()) as client:
            await client.drive("A1", 50, 50, for_s=1.0)
            await eventually(lambda: client.standing.robot == "")
            records = [each for each in swarm.seen if each.up][4:]
            assert {each.size for each in records} == {10 + 128 + 16}
            assert len(swarm.commands) < len(records)  # the others say nothing

    async def test_what_waits_for_a_slot_is_sent_after_the_robot_was_taken_away(self):
        """Before, it waited for ever."""
        async with Endpoint() as swarm, Client(swarm.url()) as client:
            await client.drive("A1", 50, 50, for_s=0.2)
            await eventually(lambda: client.standing.robot == "A1")
            asked = [asyncio.ensure_future(client.request("robots")) for _ in range(12)]
            await swarm.do(swarm.operations.take("A1", swarm.now))
            async with asyncio.timeout(10):
                answers = await asyncio.gather(*asked)
            assert client.standing.robot == ""
            assert all([robot["address"] for robot in each] == ["A1", "B2"] for each in answers)

    async def test_what_is_refused_says_why(self):
        async with Endpoint() as swarm:
            url = swarm.ticket(robots=frozenset({"B2"}))
            async with Client(url) as client:
                with pytest.raises(RequestRefused, match="not allowed") as refused:
                    await client.drive("A1", 10, 10)
                assert refused.value.why is Reason.NOT_ALLOWED
                with pytest.raises(RequestRefused):
                    await client.route("A1", [(1, 1)])
                with pytest.raises(RequestRefused, match="unknown"):
                    await client.request("weather")
                await client.drive("B2", 10, 10, for_s=0.2)
                assert client.refusals["not_allowed"] >= 2

    async def test_a_stop_ends_a_drive_and_nothing_moves_the_robot_after_it(self):
        async with Endpoint() as swarm, Client(swarm.url()) as client:
            for _ in range(3):
                drive = asyncio.create_task(client.drive("A1", 50, 50, for_s=30))
                await asyncio.sleep(0.35)
                route = asyncio.create_task(client.command("A1", "waypoints", {}))
                await asyncio.sleep(0)
                await client.stop("A1")
                assert await asyncio.wait_for(drive, 1) is False
                with pytest.raises(UsageError, match="a stop for the robot"):
                    await route
                await asyncio.sleep(0.3)
                assert swarm.commands[-1].is_stop
            assert {each.name for each in swarm.commands} == {"move_raw"}

    async def test_a_second_drive_takes_over_from_the_first(self):
        async with Endpoint() as swarm, Client(swarm.url()) as client:
            first = asyncio.create_task(client.drive("A1", 10, 10, for_s=30))
            await asyncio.sleep(0.3)
            assert await client.drive("A1", 20, 20, for_s=0.5)
            await asyncio.wait_for(first, 1)
            await asyncio.sleep(0.2)
            speeds = [json.loads(each.payload)["left_y"] for each in swarm.commands]
            assert speeds == [*sorted(speeds[:-1]), 0]

    async def test_a_late_command_does_not_end_a_drive(self):
        async with Endpoint(config=SessionConfig(commands_per_s=3)) as swarm, Client(swarm.url()) as client:
            await client.drive("A1", 10, 10, for_s=1.0)
            assert client.refusals["too_many"] > 0

    @pytest.mark.parametrize("payload", [float("nan"), {1, 2}, "x" * 16_001])
    async def test_what_cannot_be_sent_is_a_usage_error(self, payload):
        async with Endpoint() as swarm, Client(swarm.url()) as client:
            with pytest.raises(UsageError):
                await client.command("A1", "x", payload)
            with pytest.raises(UsageError):
                await client.command("no address", "x", 0)
            assert client.is_joined

    async def test_who_has_not_entered_says_nothing(self):
        async with Endpoint() as swarm:
            with pytest.raises(UsageError, match="not entered"):
                await Client(swarm.url()).stop("A1")

    @pytest.mark.parametrize("name", ["x" * 256, "a\nb", "\x1b"])
    def test_a_nickname_that_does_not_fit_is_a_usage_error(self, name):
        with pytest.raises(UsageError, match="nickname"):
            Client(Endpoint(port=1).url(), name=name)


class TestComingBack:
    async def test_the_secret_in_a_file_resumes_the_same_visitor(self, tmp_path):
        file = tmp_path / "me"
        async with Endpoint() as swarm:
            url = swarm.ticket(uses=1)
            async with Client(url, secret_file=file) as client:
                first = client.visitor
                await eventually(file.exists)
                await asyncio.sleep(0.2)
            assert stat.S_IMODE(file.stat().st_mode) == 0o600
            async with Client(url, secret_file=file) as client:
                assert client.visitor == first
            with pytest.raises(SessionOver):
                async with Client(url):
                    pass

    async def test_a_lost_connection_is_made_again_by_the_same_visitor(self):
        async with Endpoint() as swarm, Client(swarm.ticket(uses=1)) as client:
            first = client.visitor
            for _ in range(3):
                await asyncio.sleep(0.2)
                before = len(swarm.events)
                await swarm.cut()
                await eventually(lambda: client.is_joined and client.standing and len(swarm.events) > before + 3)  # noqa: B023
                assert client.visitor == first
                assert len(await client.robots()) == 2

    async def test_a_server_that_starts_again_is_rejoined_from_its_store(self):
        async with Endpoint() as swarm, Client(swarm.ticket(uses=1)) as client:
            first = client.visitor
            await asyncio.sleep(0.3)
            swarm.boot()
            await swarm.cut()
            await eventually(lambda: client.is_joined and client.standing is not None)
            assert client.visitor == first

    async def test_a_request_fails_when_the_connection_is_lost(self):
        async with Endpoint(answer=lambda event: None) as swarm, Client(swarm.url()) as client:
            asking = asyncio.create_task(client.request("robots"))
            await asyncio.sleep(0.2)
            await swarm.cut()
            with pytest.raises(Unavailable, match="lost"):
                await asking

    async def test_a_removed_visitor_stays_removed(self, tmp_path):
        file = tmp_path / "me"
        async with Endpoint() as swarm:
            url = swarm.ticket(uses=5)
            async with Client(url, secret_file=file) as client:
                await eventually(file.exists)
                await swarm.do(swarm.operations.remove(client.visitor, swarm.now))
                await eventually(lambda: not client.is_joined)
                for attempt in (client.stop("A1"), client.robots(), anext(client.updates())):
                    with pytest.raises(SessionOver) as over:
                        await attempt
                    assert over.value.why is EndReason.REMOVED
            with pytest.raises(SessionOver):
                async with Client(url, secret_file=file):
                    pass

    async def test_a_file_of_another_swarm_is_not_used_and_another_file_is_left_as_it_is(self, tmp_path):
        file = tmp_path / "me"
        async with Endpoint() as one, Endpoint() as other:
            async with Client(one.url(), secret_file=file):
                await eventually(file.exists)
            async with Client(other.url(), secret_file=file) as client:
                assert client.visitor == 1
        file.write_text("dear diary")
        with pytest.raises(UsageError, match="is no session file"):
            Client(one.url(), secret_file=file)
        assert file.read_text() == "dear diary"

    async def test_a_swarm_that_stays_away_ends_the_session(self):
        async with Endpoint() as swarm:
            client = Client(swarm.url(), away_s=0.5)
            async with client:
                await swarm.__aexit__()
                with pytest.raises(Unavailable, match="no connection"):
                    async for _ in client.updates():
                        pass


class TestHostileServers:
    async def test_nobody_there_and_nobody_who_answers(self):
        async with Endpoint() as swarm:
            url = swarm.url()
            swarm.server.receive = lambda *args: []
            with pytest.raises(Unavailable, match="no answer"):
                async with Client(url, timeout_s=0.5):
                    pass
        with pytest.raises(Unavailable):
            async with Client(url, timeout_s=0.5):
                pass

    async def test_an_impostor_with_another_key_is_not_believed(self):
        async with Endpoint() as swarm, Endpoint() as impostor:
            impostor.server.connections._find_secret = lambda *args: swarm.server.door.code  # which visitors know
            url = swarm.url().replace(f":{swarm.port}/", f":{impostor.port}/")
            with pytest.raises(SessionOver):
                async with Client(url):
                    pass
            assert impostor.server.rejected == {"not_authentic": 1}

    async def test_a_secret_that_nobody_gave_is_refused(self):
        async with Endpoint() as swarm:
            with pytest.raises(SessionOver, match="does not admit"):
                async with Client(swarm.url(Secret(Kind.TICKET, os.urandom(16)))):
                    pass

    @pytest.mark.parametrize(
        "raw", [b"", b"[", b"NaN", b'{"a":1,"a":2}', b"1e999", b"\xff", b"[" * 100_000, b"9" * 5000]
    )
    async def test_a_reply_that_is_not_json_is_a_peer_error(self, raw):
        async with Endpoint(answer=lambda event: raw) as swarm, Client(swarm.url()) as client:
            with pytest.raises(BadPayload):
                await client.robots()
            swarm.state = lambda: raw
            await eventually(lambda: not client._updates or client._updates[-1] == raw)
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.3):
                    async for update in client.updates():
                        assert update == {"seq": 1}
            assert client.rejected["bad_payload"] > 0

    async def test_unread_updates_are_bounded(self):
        async with Endpoint(tick_s=0.001) as swarm, Client(swarm.url()) as client:
            swarm.state = lambda: b'"' + b"x" * 100_000 + b'"'
            await eventually(lambda: client.dropped > 50)
            assert sum(map(len, client._updates)) <= 4 * 1024 * 1024

    @settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.lists(st.binary(max_size=200) | st.sampled_from(["text", None]), max_size=6))
    def test_garbage_raises_nothing_but_peer_errors(self, messages):
        async def visit():
            async def speak(request):
                socket = web.WebSocketResponse()
                await socket.prepare(request)
                for message in messages:
                    if message is None:
                        await socket.close()
                        break
                    await (socket.send_str(message) if isinstance(message, str) else socket.send_bytes(message))
                return socket

            app = web.Application()
            app.router.add_get("/link", speak)
            runner = web.AppRunner(app, shutdown_timeout=0.1)
            await runner.setup()
            await web.TCPSite(runner, "127.0.0.1", 0).start()
            endpoint = Endpoint(port=runner.addresses[0][1])
            try:
                async with Client(endpoint.url(), timeout_s=0.3):
                    pass
            except (PeerError, Unavailable):
                pass
            await runner.cleanup()

        asyncio.run(visit())


async def test_whoever_is_cancelled_while_a_websocket_closes_leaves_nothing_open(monkeypatch):
    async def cancelled(_):
        raise asyncio.CancelledError

    monkeypatch.setattr(WebsocketTransport, "close", cancelled)
    way = WebsocketTransport("ws://127.0.0.1:1", 1, Counter())
    with pytest.raises(asyncio.CancelledError):
        await way.__aexit__()
    assert way._http.closed
