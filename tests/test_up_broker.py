"""Visitors who come by a real mosquitto, where others read, replay and flood."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from functools import partial

import aiomqtt
import pytest
from aiomqtt.client import ProtocolVersion

from brokers import a_broker, bare_mosquitto
from commands import a_gateway, run
from phalanx.config.session import SessionConfig
from phalanx.errors import PeerError, Unavailable
from phalanx.gateway import Gateway
from phalanx.gateway.session_link import SessionLink, now
from phalanx.gateway.trail import Trail
from phalanx.link.session import EndReason, MemoryStore, parse_invitation
from phalanx.link.session.events import Close, Send, SetConnectionTopics
from phalanx.link.session.events import Publish as Update
from phalanx.link.session.secret import hello_topic
from phalanx.net.broker import RunningBroker
from phalanx.net.broker_url import BrokerUrl
from phalanx.net.session_broker import HELLO_CONNECTION, MORE_BYTES, ROW_BYTES, SessionBroker
from phalanx.net.session_client import Client, SessionOver
from phalanx.net.session_store import new_link_keys
from phalanx.wire.sessions import SIGNED_HELLO, UPDATE
from phalanx.world import Dotbots
from ports import free_port
from serving import meanwhile, up_here
from session_front import FakeFront
from waiting import eventually

pytestmark = pytest.mark.waits
ROOT = "/lab"


class Spy:
    """Somebody else at the broker, who hears all."""

    def __init__(self, broker):
        self.client = aiomqtt.Client(broker.url.host, broker.url.port, protocol=ProtocolVersion.V311)
        self.heard: list[tuple[str, bytes]] = []

    async def __aenter__(self):
        await self.client.__aenter__()
        await self.client.subscribe("#")
        self._reads = asyncio.create_task(self._read())
        return self

    async def __aexit__(self, *_):
        self._reads.cancel()
        await self.client.__aexit__(None, None, None)

    async def _read(self):
        async for message in self.client.messages:
            self.heard.append((str(message.topic), message.payload))

    async def say(self, topic, data, **more):
        await self.client.publish(topic, data, **more)

    def topics(self):
        return {topic for topic, _ in self.heard}


@asynccontextmanager
async def elsewhere(folder):
    """A mosquitto of somebody else's, who keeps messages as well."""
    tcp, ws = free_port(), free_port()
    with bare_mosquitto(tcp, ws, folder) as (start, _):
        start()
        yield RunningBroker("external", BrokerUrl("mqtt", "127.0.0.1", tcp), f"ws://127.0.0.1:{ws}/mqtt")


@asynccontextmanager
async def a_swarm(where=a_broker, **config):
    """A gateway, its broker, and a spy there."""
    swarm, keys = Dotbots(2, 1, time.time), new_link_keys()
    async with where() as broker, FakeFront() as front, Spy(broker) as spy:
        config = SessionConfig(root=ROOT, broker=broker.websocket, **config)
        knocks = hello_topic(keys.static.public_key())
        async with SessionBroker(broker.url, ROOT, knocks, config.max_to_server_bytes) as way:
            await way.wait_connected(10)
            robots = [robot.address for robot in swarm.robots()]
            link = SessionLink(front, MemoryStore(), keys, lambda: robots, Trail(None), config, broker=way)
            link.gateway, link.way, link.spy, link.robots = Gateway(swarm, link), way, spy, robots
            link.url = lambda: f"http://page/#{link.invitation.fragment()}"
            link.knocks = f"{ROOT}/{knocks}"
            async with meanwhile(link.run(), link.gateway.run()):
                yield link
            link.trail.close()


async def test_a_visitor_joins_by_the_code_drives_and_sees_it():
    with a_gateway("--broker", "mosquitto", "--robots", "3") as (_, ready):
        shown = parse_invitation(ready["session_url"])
        assert shown.broker.startswith("ws://127.0.0.1:")
        assert (shown.root, shown.mqtt) == ("/qrkey", 5)
        for mqtt in (5, 4):
            url = f"http://page/#{replace(shown, mqtt=mqtt).fragment()}"
            async with Client(url, name="Ada") as ada:
                await anext(ada.updates())
                robot = (await ada.robots())[0]  # it is free at once when its driver leaves
                assert await ada.drive(robot["address"], 60, 60, for_s=1.0)
                assert (await ada.robots())[0]["lh2_position"] != robot["lh2_position"]
                await ada.stop(robot["address"])
                assert ada.rejected == {}
                assert ada.refusals == {}
        drive = ("--drive", robot["address"], "--left", "30", "--for", "0.5")
        visited = await asyncio.to_thread(run, "link", "connect", "-", *drive, input=ready["session_url"])
        assert visited.returncode == 0, visited.stderr


async def test_who_is_removed_learns_so_and_the_old_code_admits_nobody():
    async with a_swarm() as link:
        before = link.url()
        async with Client(before, name="Eve") as eve, Client(before, name="Ada") as ada:
            link.carry(link.operations.remove(eve.visitor, now()))
            updates = eve.updates()
            with pytest.raises(SessionOver) as over:
                while True:
                    await anext(updates)
            assert over.value.why is EndReason.REMOVED
            with pytest.raises(Unavailable, match="no answer"):
                async with Client(before, timeout_s=2):
                    pass
            async with Client(link.url()) as again:
                assert again.standing.waiting
            await ada.drive(link.robots[0], 30, 30, for_s=0.3)
            assert link.counters["commands"] >= 2


@pytest.mark.parametrize("says_so", [True, False])
async def test_a_session_outlives_a_broker_and_a_gateway_that_come_back(tmp_path, state, monkeypatch, says_so):
    tcp, ws = free_port(), free_port()
    where = {"broker": f"mqtt://127.0.0.1:{tcp}", "broker_ws": f"ws://127.0.0.1:{ws}/mqtt"}

    async def nothing(_):
        """As when it is killed."""

    if not says_so:
        monkeypatch.setattr(SessionLink, "close", nothing)

    def running():
        return up_here(Dotbots(2, 1, time.time), state=state, **where)

    with bare_mosquitto(tcp, ws, tmp_path) as (start, kill):
        start()
        async with AsyncExitStack() as first:
            _, ready = await first.enter_async_context(running())
            async with Client(ready["session_url"], secret_file=tmp_path / "secret") as ada:
                visitor, robots = ada.visitor, await ada.robots()
                kill()
                with pytest.raises(Unavailable):
                    await ada.request("robots", timeout_s=1)
                start()
                await drives(ada, robots[0]["address"])
                await first.aclose()
                async with running() as (_, ready):  # with another open code
                    await drives(ada, robots[0]["address"])
                    await ada.leave()
                    async with Client(ready["session_url"], secret_file=tmp_path / "secret") as ada:
                        assert ada.visitor == visitor


async def drives(client, robot):
    """Until it does: a session may have to be resumed first."""
    for _ in range(100):
        try:
            if await client.drive(robot, 30, 30, for_s=0.3):
                return
        except (PeerError, Unavailable):
            await asyncio.sleep(0.2)
    raise AssertionError("it does not drive")


async def test_new_keys_change_all_topics_and_old_ones_are_left():
    async with a_swarm(epoch_ms=2000, epoch_notice_ms=500, overlap_ms=500) as link:
        config = SessionConfig(rekey_ms=1500, overlap_ms=500)
        async with Client(link.url(), config=config) as ada:
            await ada.drive(link.robots[0], 30, 30, for_s=0.5)
            before = link.spy.topics() - {link.knocks}
            await asyncio.sleep(5)
            link.spy.heard.clear()
            assert await ada.drive(link.robots[0], 30, 30, for_s=0.5)
            after = link.spy.topics() - {link.knocks}
            assert before
            assert after
            assert not before & after
            assert len(link.way._of) <= 4
            assert len(list(link.server.connections)) == 1
            assert ada.rejected == {}


async def test_what_others_replay_splice_and_forge_there_changes_nothing(tmp_path):
    async with a_swarm(partial(elsewhere, tmp_path)) as link:
        joined = []
        link.say = lambda event: joined.append(event) if event["event"] == "joined" else None
        async with Client(link.url(), name="Ada") as ada, Client(link.url(), name="Bob") as bob:
            for who, robot in ((ada, 0), (bob, 1)):
                await who.drive(link.robots[robot], 30, 30, for_s=0.5)
            heard = link.spy.heard[:200]
            every = sorted({topic for topic, _ in heard})
            updates = [(topic, data) for topic, data in heard if data[:1] == UPDATE.encode(**NOTHING)[:1]]
            assert updates
            for topic, data in heard:
                await link.spy.say(topic, data)
                await link.spy.say(every[hash(data) % len(every)], data)
                await link.spy.say(topic, data[:-1] + bytes([data[-1] ^ 1]), retain=True)
            for topic, data in updates[-3:]:
                forged = UPDATE.decode(data)
                await link.spy.say(topic, UPDATE.encode(**forged | {"counter": forged["counter"] + 100}))
            await eventually(lambda: ada.rejected.get("not_authentic"))
            await asyncio.sleep(0.5)
            assert link.counters["commands"] == ada.commands + bob.commands
            for who, robot in ((ada, 0), (bob, 1)):
                assert await who.drive(link.robots[robot], 30, 30, for_s=0.5)
            await asyncio.sleep(0.3)
            assert link.counters["commands"] == ada.commands + bob.commands
            assert len(joined) == 2
            # What is retained is heard by all who subscribe later.
            async with Client(link.url()) as eve:
                await eve.robots()


NOTHING = {"epoch": 0, "counter": 0, "signature": bytes(64), "sealed": b""}


async def test_a_flood_of_first_messages_without_the_secret_costs_no_dh_and_keeps_nobody_out(monkeypatch):
    computed = []
    from phalanx.link.session import connections

    respond = connections.respond
    monkeypatch.setattr(connections, "respond", lambda *a: computed.append(a) or respond(*a))
    async with a_swarm() as link:
        good = SIGNED_HELLO.encode(kind=1, id=link.invitation.secret.id, noise=bytes(48), mac1=bytes(16))

        async def flood():
            while True:
                for each in (good, good[:-1], bytes(100_000), b"", bytes(74)):
                    await link.spy.say(link.knocks, each)
                await asyncio.sleep(0)

        flooding = asyncio.create_task(flood())
        await eventually(lambda: link.rejected["not_authentic"] > 200 and link.rejected["malformed_record"] > 200)
        assert not computed
        async with Client(link.url(), timeout_s=30) as ada:
            assert await ada.drive(link.robots[0], 30, 30, for_s=0.5)
        flooding.cancel()
        assert len(computed) < 10


class TestTurns:
    async def test_who_floods_its_topic_has_one_turn_in_each_round_and_room_for_a_few(self):
        async with a_broker() as broker, Spy(broker) as spy, SessionBroker(broker.url, ROOT, "knocks", 1000) as way:
            await way.wait_connected(10)
            way.carry(SetConnectionTopics(-1, ("one",)))
            way.carry(SetConnectionTopics(-2, ("two",)))
            way.carry(Send(-1, b"ready", "ready"))
            await eventually(lambda: (f"{ROOT}/ready", b"ready") in spy.heard)
            flood = bytes(SIGNED_HELLO.size)
            row = ROW_BYTES // (len(flood) + MORE_BYTES)
            for _ in range(row + 50):
                await spy.say(f"{ROOT}/one", flood)
                await spy.say(f"{ROOT}/knocks", flood)
            await spy.say(f"{ROOT}/knocks", flood[1:])
            await spy.say(f"{ROOT}/two", b"honest")
            await spy.say(f"{ROOT}/two", bytes(2000))
            await spy.say(f"{ROOT}/nobody's", b"x")
            await eventually(lambda: way.rejected["too_large"])
            assert way.rejected == {"overrun": 100, "too_large": 1, "malformed_record": 1}
            events = way.events()
            assert {(await anext(events)).connection for _ in range(3)} == {HELLO_CONNECTION, -1, -2}
            rest = [(await anext(events)).connection for _ in range(2 * row - 2)]
            assert not way._rows
            assert not way._unread_bytes
            assert rest[:4] in ([-1, HELLO_CONNECTION] * 2, [HELLO_CONNECTION, -1] * 2)

    async def test_topics_of_a_connection_that_is_over_are_left(self):
        async with a_broker() as broker, Spy(broker) as spy, SessionBroker(broker.url, ROOT, "knocks", 1000) as way:
            await way.wait_connected(10)
            way.carry(SetConnectionTopics(-1, ("one", "two")))
            way.carry(SetConnectionTopics(-1, ("two", "three")))
            assert set(way._of) == {f"{ROOT}/{each}" for each in ("knocks", "two", "three")}
            await spy.say(f"{ROOT}/two", b"x")
            way.carry(Close(-1, "leave"))
            way.carry(Close(HELLO_CONNECTION, "failed"))
            assert set(way._of) == {f"{ROOT}/knocks"}
            way.carry(Send(-1, b"ready", "ready"))
            await eventually(lambda: (f"{ROOT}/ready", b"ready") in spy.heard)
            assert not way._rows

    async def test_an_update_that_is_not_out_yet_is_not_followed_by_another(self):
        async with a_broker() as broker, Spy(broker) as spy, SessionBroker(broker.url, ROOT, "knocks", 1000) as way:
            way.carry(Update((-1,), b"before", "topic"))
            await way.wait_connected(10)
            for each in (b"first", b"second"):
                way.carry(Update((-1,), each, "topic"))
            await eventually(lambda: way._update is None)
            way.carry(Update((-1,), b"third", "topic"))
            await eventually(lambda: (f"{ROOT}/topic", b"third") in spy.heard)
            assert [data for topic, data in spy.heard if topic == f"{ROOT}/topic"] == [b"first", b"third"]
