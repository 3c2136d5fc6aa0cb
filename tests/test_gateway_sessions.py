"""Visitors over sessions: a gateway, its swarm and real websockets."""

from __future__ import annotations

import asyncio
import time

import pytest

from phalanx.errors import BadPayload, Unavailable
from phalanx.gateway.chain_file import read_lines
from phalanx.gateway.operator_desk import OperatorDesk
from phalanx.gateway.payloads import JSON_DEPTH, parse_payload
from phalanx.gateway.session_link import ASKED_BYTES, now
from phalanx.link import Command
from phalanx.link.session import Invitation, MemoryStore, Reason, Role, parse_invitation
from phalanx.link.session.errors import EndReason
from phalanx.link.session.events import Send, Transmit
from phalanx.link.topics import CommandTopic
from phalanx.net.session_store import new_link_keys
from phalanx.robot import Led
from phalanx.world import Dotbots
from serving import serving
from session_front import visiting
from waiting import eventually

pytestmark = pytest.mark.waits


def at(swarm, i=0):
    return swarm.robots()[i].at


async def drive_until(visit, robot, there):
    for _ in range(100):
        await visit.command(robot, "move_raw", {"left_y": 60, "right_y": 60})
        await asyncio.sleep(0.05)
        if there():
            return
    raise AssertionError("it does not move")


async def test_a_visitor_joins_drives_sees_it_move_is_removed_and_stays_removed():
    swarm, store, keys = Dotbots(3, 1, time.time), MemoryStore(), new_link_keys()
    async with serving(swarm, store, keys) as link:
        shown = link.invitation
        async with visiting(link.port, shown, "Ada") as ada:
            await eventually(lambda: ada.frames)
            robots, area = await ada.request("robots"), await ada.request("area")
            assert area == {"width": 2000, "height": 2000}
            robot, began = robots[0]["address"], at(swarm)
            await drive_until(ada, robot, lambda: at(swarm) != began)
            before = len(ada.frames)
            await eventually(lambda: any("places" in frame for frame in ada.frames[before:]))
            await eventually(lambda: [0, ["Ada"]] in [d for f in ada.frames for d in f.get("drivers", [])])
            assert ada.standing.robot == robot
            link.carry(link.operations.remove(ada.visitor, now()))
            await eventually(lambda: ada.ended is EndReason.REMOVED)
            secret, seen = ada.secret, len(ada.frames)
            await asyncio.sleep(0.4)
            assert len(ada.frames) == seen
        for again in (shown, Invitation(shown.static, secret)):
            async with visiting(link.port, again) as ada:
                await eventually(lambda: ada.ws.closed)
                assert ada.visitor is None
    async with serving(swarm, store, keys) as link:
        for again in (shown, Invitation(shown.static, secret)):
            async with visiting(link.port, again) as ada:
                await eventually(lambda: ada.ws.closed)
                assert ada.visitor is None


async def test_a_restart_keeps_a_session_resumable_and_its_robot_free():
    swarm, store, keys = Dotbots(1, 1, time.time), MemoryStore(), new_link_keys()
    async with serving(swarm, store, keys) as link, visiting(link.port, link.invitation, "Ada") as ada:
        await eventually(lambda: ada.frames and ada.secret)
        await ada.request("area")  # `stored` was read before
        secret, visitor = ada.secret, ada.visitor
    async with serving(swarm, store, keys) as link:
        async with visiting(link.port, Invitation(link.invitation.static, secret)) as again:
            await eventually(lambda: again.frames)
            assert (again.visitor, again.name) == (visitor, "Ada")


async def test_what_the_gateway_refuses_the_visitor_hears_and_a_stop_stops_whatever_its_payload_says():
    swarm = Dotbots(2, 1, time.time)
    robot = swarm.robots()[0].address
    async with serving(swarm) as link, visiting(link.port, link.invitation, "Ada") as ada:
        await eventually(lambda: ada.frames)
        for name, payload, reason in (
            ("move_raw", {"left_y": "fast"}, Reason.BAD),
            ("dance", {}, Reason.UNKNOWN),
        ):
            await ada.command(robot, name, payload)
            await eventually(lambda reason=reason: ada.refused and ada.refused[-1] == (0, reason))
        await ada.do([ada.client.command(robot, "move_raw", b'{"left_y":1,"left_y":2}', now().ms)])
        await eventually(lambda: len(ada.refused) == 3 and ada.refused[-1] == (0, Reason.BAD))
        await ada.command("FFFF", "move_raw", {"left_y": 1, "right_y": 1})
        await eventually(lambda: ada.refused[-1] == (0, Reason.NOT_ALLOWED))
        await ada.command(robot, "rgb_led", {"red": 1, "green": 2, "blue": 3})
        await eventually(lambda: swarm.robots()[0].led == Led(1, 2, 3))
        route = {"threshold": 60, "waypoints": [{"x": 1000, "y": 1000}] * 3}
        await ada.command(robot, "waypoints", route)
        await eventually(lambda: swarm.robots()[0].route)
        for _ in range(3):
            await ada.command(robot, "waypoints", route)
        await eventually(lambda: ada.refused[-1] == (0, Reason.TOO_MANY))
        await ada.command(robot, "move_raw", {"left_y": 100, "right_y": 100}, stop=True)
        await eventually(lambda: not swarm.robots()[0].route)
        link.gateway.brakes.hold()
        await ada.command(robot, "move_raw", {"left_y": 60, "right_y": 60})
        await eventually(lambda: ada.refused[-1] == (0, Reason.HELD))
        with pytest.raises(PermissionError, match="UNKNOWN"):
            await ada.request("visitors")
        assert ada.ended is None


async def test_only_one_drives_a_robot_and_a_page_that_invents_a_name_is_shown_by_its_own():
    swarm = Dotbots(2, 1, time.time)
    robot = swarm.robots()[0].address
    async with (
        serving(swarm) as link,
        visiting(link.port, link.invitation, "Ada") as ada,
        visiting(link.port, link.invitation, "Bob") as bob,
    ):
        await eventually(lambda: ada.frames and bob.frames)
        await ada.command(robot, "move_raw", {"left_y": 60, "right_y": 60, "by": "bob"})
        await eventually(lambda: any(frame.get("drivers") == [[0, ["Ada"]]] for frame in bob.frames))
        await bob.command(robot, "move_raw", {"left_y": 60, "right_y": 60})
        await eventually(lambda: bob.refused == [(0, Reason.BUSY)])
        await eventually(lambda: len({*ada.raw_updates} & {*bob.raw_updates}) >= 3)  # sealed once for all


async def test_everybody_sees_who_has_a_robot_and_what_the_shared_code_had_it_follow_ends():
    swarm = Dotbots(2, 1, time.time)
    first, second = (robot.address for robot in swarm.robots())
    route = {"threshold": 60, "waypoints": [{"x": 1900, "y": 1900}, {"x": 100, "y": 100}]}
    async with (
        serving(swarm) as link,
        visiting(link.port, link.invitation, "Ada") as ada,
        visiting(link.port, link.invitation, "Bob") as bob,
    ):
        await eventually(lambda: ada.frames and bob.frames)
        for robot in (first, second):
            link._commands["waypoints"](Command(CommandTopic(robot, "0", "waypoints"), route))
        await ada.command(first, "rgb_led", {"red": 1, "green": 2, "blue": 3})
        await eventually(lambda: any(frame.get("drivers") == [[0, ["Ada"]]] for frame in bob.frames))
        assert [bool(robot.route) for robot in swarm.robots()] == [False, True]
        await ada.command(first, "waypoints", route)
        await ada.command(first, "rgb_led", {"red": 3, "green": 2, "blue": 1})
        await eventually(lambda: swarm.robots()[0].led == Led(3, 2, 1))
        assert swarm.robots()[0].route, "her own goes on"
        desk = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", print)
        desk.do("give", {"robot": second, "visitor": bob.visitor})
        await eventually(lambda: not swarm.robots()[1].route)
        await eventually(lambda: any(frame.get("drivers") == [[1, ["Bob"]]] for frame in ada.frames))


@pytest.mark.parametrize(
    ("payload", "refused"),
    [
        (b"[" * (JSON_DEPTH + 1) + b"]" * (JSON_DEPTH + 1), True),
        (b"[" * JSON_DEPTH + b"]" * JSON_DEPTH, False),
        (b"[" * 8000, True),
        (b'{"a":' * 2000 + b"1" + b"}" * 2000, True),
        (b'{"a":1,"a":1}', True),
        (b"NaN", True),
        (b"1e999", True),
        (b"9" * 9000, True),
        (b"\xff", True),
        (b"", True),
        (b'{"a":[1,2.5,null,true,"x"]}', False),
    ],
)
def test_payloads_are_strict_json_of_few_levels(payload, refused):
    if refused:
        with pytest.raises(BadPayload):
            parse_payload(payload)
    else:
        parse_payload(payload)


async def test_an_operator_by_a_ticket_removes_gives_and_lets_in_and_a_driver_does_not(tmp_path):
    swarm = Dotbots(3, 1, time.time)
    first, second, _ = (robot.address for robot in swarm.robots())
    async with serving(swarm, trail=tmp_path / "trail", assign="one-each", requests_per_s=100) as link:
        held = []
        desk = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", held.append)
        link.operate = desk.operate
        ticket = parse_invitation(desk.do("invite", {"role": "operate"})["url"])
        async with (
            visiting(link.port, ticket, "Op") as op,
            visiting(link.port, link.invitation, "Ada") as ada,
            visiting(link.port, link.invitation, "Eve") as eve,
        ):
            await eventually(lambda: op.frames and ada.frames and eve.frames)
            for request in ("visitors", "remove", "everybody_out", "invite", "stop", "nothing"):
                with pytest.raises(PermissionError, match="NOT_ALLOWED"):
                    await ada.request(request, {"visitor": eve.visitor})
            listed = await op.request("visitors")
            assert {each["name"]: each["robot"] for each in listed["visitors"]} == {
                "Op": "",
                "Ada": first,
                "Eve": second,
            }
            await op.request("swap", {"robots": [first, second]})
            await eventually(lambda: ada.standing.robot == second and eve.standing.robot == first)
            await op.request("role", {"visitor": ada.visitor, "role": "watch"})
            await eventually(lambda: ada.standing.role is Role.WATCH and ada.standing.robot == "")
            route = {"threshold": 60, "waypoints": [{"x": 1000, "y": 1000}]}
            await eve.command(first, "waypoints", route)
            await eventually(lambda: swarm.robots()[0].route)
            await op.request("remove", {"visitor": eve.visitor})
            await eventually(lambda: eve.ended is EndReason.REMOVED and not swarm.robots()[0].route)
            for wrong in ({"visitor": 99}, {"visitor": True}, {}, {"visitor": "1"}, []):
                with pytest.raises(PermissionError, match=r"BAD|UNKNOWN"):
                    await op.request("approve", wrong)
            async with visiting(link.port, link.invitation, "Eve") as back:
                await eventually(lambda: back.standing and back.standing.waiting)
                assert not back.frames
                await op.request("approve", {"visitor": back.visitor})
                await eventually(lambda: back.frames)
            await op.request("give", {"robot": swarm.robots()[2].name, "visitor": op.visitor})
            await op.request("take", {"robot": swarm.robots()[2].address})
            assert len((await op.request("room", {"show": True}))["room"]) == 8
            code = await op.request("code")
            assert code["url"].startswith("http://x/#j=")
            assert "<svg" in code["svg"]
            await op.request("stop")
            assert held == [True]
            await op.request("door", {"open": True})
            await op.request("everybody_out")
            await eventually(lambda: ada.ended is EndReason.NEW_CODE)
            assert op.ended is None
            with pytest.raises(PermissionError, match="BAD"):
                await op.request("role", {"visitor": op.visitor, "role": "operate"})
    told = [line["event"] for line in read_lines(tmp_path / "trail")]
    wanted = ["invited", "swapped", "role", "removed", "approved", "given", "taken", "room", "stopped_all", "door"]
    assert [each for each in told if each in wanted] == wanted
    assert "payload" not in (tmp_path / "trail").read_text()


async def test_a_new_code_locks_out_whoever_has_the_one_before_at_once_and_nobody_who_is_here():
    async with serving(Dotbots(1, 1, time.time)) as link, visiting(link.port, link.invitation, "Ada") as ada:
        await eventually(lambda: ada.frames)
        before = link.invitation
        desk = OperatorDesk(link, Dotbots(1, 1, time.time), link.gateway.brakes, "http://x/", print)
        assert desk.do("new_code", {})["url"] == "http://x/#" + link.invitation.fragment()
        async with visiting(link.port, before) as late:
            await eventually(lambda: late.ws.closed)
        seen = len(ada.frames)
        await eventually(lambda: len(ada.frames) > seen)


async def test_an_operator_stops_all_robots_while_everybody_asks_without_end():
    swarm, held = Dotbots(1, 1, time.time), []
    async with serving(swarm) as link:
        link.operate = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", held.append).operate
        ticket = parse_invitation(link.operate("invite", {"role": "operate"}, 0)["url"])
        asked = asyncio.Event()
        link._requests["robots"] = lambda _: asked.wait()  # one that is answered, and holds up all others
        async with visiting(link.port, ticket) as op, visiting(link.port, link.invitation) as ada:
            await eventually(lambda: op.frames and ada.frames)
            for name in ("robots", "area"):
                asyncio.ensure_future(ada.request(name)).add_done_callback(lambda done: done.exception())
            await eventually(lambda: link._answers._waiting)
            await op.request("stop")
            assert held == [True]
            with pytest.raises(PermissionError, match="TOO_MANY"):
                await ada.request("area", {"words": "x" * ASKED_BYTES})
            asked.set()


async def test_who_waits_sees_no_robots_and_asks_again_once_approved():
    swarm = Dotbots(2, 1, time.time)
    async with serving(swarm) as link:
        link.operations.close_door()
        async with visiting(link.port, link.invitation, "Eve") as eve:
            await eventually(lambda: eve.standing and eve.standing.waiting)
            for request in ("robots", "area", "walls", "lit", "visitors"):
                with pytest.raises(PermissionError, match="NOT_ALLOWED"):
                    await eve.request(request)
            assert not eve.frames
            link.carry(link.operations.approve(eve.visitor, now()))
            assert len(await eve.request("robots")) == 2


async def test_a_refused_command_takes_no_robot_and_a_resumed_visitor_has_no_more_routes():
    swarm = Dotbots(2, 1, time.time)
    robot = swarm.robots()[0].address
    route = {"threshold": 60, "waypoints": [{"x": 1000, "y": 1000}]}
    async with serving(swarm) as link, visiting(link.port, link.invitation, "Bob") as bob:
        async with visiting(link.port, link.invitation, "Ada") as ada:
            await eventually(lambda: ada.frames and bob.frames)
            for name, payload in (
                ("move_raw", {"left_y": "fast"}),
                ("dance", {}),
                ("waypoints", {"waypoints": [0] * 65}),
            ):
                await ada.command(robot, name, payload)
            await eventually(lambda: len(ada.refused) == 3)
            assert link.server.assignment.robot_of(ada.visitor) is None
            await bob.command(robot, "rgb_led", {"red": 1, "green": 2, "blue": 3})
            await eventually(lambda: swarm.robots()[0].led == Led(1, 2, 3))
            assert link.server.assignment.robot_of(bob.visitor) == robot
            link.carry(link.operations.give(robot, ada.visitor, now()))
            await eventually(lambda: ada.standing.robot == robot)
            caps = link.server.caps.of(ada.visitor, now().ms)
            await ada.command(robot, "waypoints", route)
            await eventually(lambda: swarm.robots()[0].route)
            secret = ada.secret
        async with visiting(link.port, Invitation(link.invitation.static, secret)) as ada:
            await eventually(lambda: ada.frames)
            assert link.server.caps.of(ada.visitor, now().ms) is caps
            for _ in range(40):
                await ada.command(robot, "waypoints", route)
            await eventually(lambda: ada.refused and ada.refused[-1] == (0, Reason.TOO_MANY))


async def test_a_ticket_whose_connection_died_before_the_secret_came_admits_again():
    swarm = Dotbots(1, 1, time.time)
    async with serving(swarm) as link:
        desk = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", lambda _: None)
        ticket = parse_invitation(desk.do("invite", {"role": "drive", "name": "Ada"})["url"])
        async with visiting(link.port, ticket) as lost:
            lost.client.stored = lambda *_: Transmit(b"")  # what says that it has the secret gets lost
            await eventually(lambda: len(link.server.visitors) == 1)
        async with visiting(link.port, ticket) as ada:
            await eventually(lambda: ada.frames and ada.secret)
            assert (ada.name, len(link.server.visitors)) == ("Ada", 1)
            await ada.request("area")
            async with visiting(link.port, ticket) as third:
                await eventually(lambda: third.ws.closed)
                assert third.visitor is None
            assert ada.ended is None


async def test_a_tickets_name_is_one_that_can_be_read():
    swarm = Dotbots(1, 1, time.time)
    async with serving(swarm) as link:
        desk = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", lambda _: None)
        for name in ("\u3164", "A\u202eda", "A" + "\u0316" * 9, "x" * 33):
            with pytest.raises(BadPayload, match="name"):
                desk.do("invite", {"role": "drive", "name": name})
        assert desk.do("invite", {"role": "drive", "name": "Zoë"})["url"]


class SlowStore(MemoryStore):
    """Counts writes; the disk may be full."""

    def __init__(self):
        super().__init__()
        self.writes, self.is_full, self.seen = 0, False, []

    def write(self, rows):
        if self.is_full:
            raise Unavailable("no room")
        self.writes += 1
        super().write(rows)


async def test_joins_of_one_turn_wait_for_the_disk_once_and_are_told_afterwards(monkeypatch):
    store = SlowStore()
    async with serving(Dotbots(1, 1, time.time), store) as link:
        said = []
        monkeypatch.setattr(link._ways, "carry", lambda _: said.append(store.writes))
        link._held.update({1: [], 2: []})
        link._store.is_grouping = True
        link._store.write({b"a": b"1"})
        link._store.write({b"b": b"2"})
        link._store.is_grouping = False
        link.carry([Send(1, b""), Send(2, b"")])
        assert (said, store.writes) == ([], 0)
        link._commit()
        assert (said, store.writes) == ([1, 1], 1)
        assert {b"a", b"b"} <= store.rows.keys()


async def test_nobody_is_told_of_what_a_full_disk_did_not_take_and_who_drives_goes_on():
    swarm, store = Dotbots(1, 1, time.time), SlowStore()
    async with serving(swarm, store) as link, visiting(link.port, link.invitation, "Ada") as ada:
        await eventually(lambda: ada.frames and ada.secret)
        await ada.request("area")
        store.is_full = True
        async with visiting(link.port, link.invitation, "Eve") as eve:
            await eventually(lambda: eve.ws.closed)
            assert eve.visitor is None
        began = at(swarm)
        await drive_until(ada, swarm.robots()[0].address, lambda: at(swarm) != began)
        store.is_full = False
        async with visiting(link.port, link.invitation, "Bob") as bob:
            await eventually(lambda: bob.visitor)
