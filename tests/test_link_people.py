"""`phalanx link people`, `kick`, `approve` and `assign` with a gateway that runs, as an operator uses them."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import AsyncExitStack, asynccontextmanager
from types import SimpleNamespace

import pytest

from commands import a_gateway, called
from phalanx.cli.gateway_of import ask_gateway
from phalanx.gateway.operator_desk import OperatorDesk
from phalanx.gateway.projector import Projector
from phalanx.link.session import Role, parse_invitation
from phalanx.link.session.errors import EndReason
from phalanx.world import Dotbots
from serving import serving
from session_front import visiting
from waiting import eventually

pytestmark = pytest.mark.waits


async def link(*words: str) -> tuple[int, str, str]:
    done = await asyncio.to_thread(called, "link", *words)
    return done.returncode, done.stdout, done.stderr


async def asked(*words: str):
    code, out, err = await link(*words, "--json")
    assert code == 0, err
    return json.loads(out)


def by_code(url: str, name: str):
    return visiting(int(url.partition("/#")[0].rpartition(":")[2]), parse_invitation(url), name)


@asynccontextmanager
async def visitor(name: str):
    """Somebody who has just scanned the code."""
    url = (await asyncio.to_thread(ask_gateway, None, "link/code", {}))["url"]
    async with by_code(url, name) as visit:
        await eventually(lambda: visit.standing or visit.ended)
        yield visit


async def test_an_operator_manages_visitors_from_a_terminal():
    with a_gateway("--robots", "3") as (_, ready):
        robots = (await asyncio.to_thread(ask_gateway, None, "link/state", {}))["robots"]
        mine, name = robots[1]["address"], robots[1]["name"]
        async with visitor("Ada") as ada, visitor("Bob") as bob, visitor("1"):
            assert (await link("assign", "Ada", name))[:2] == (0, f"Ada has {name}\n")
            await eventually(lambda: ada.standing.robot == mine)
            listed = await asked("people")
            assert (listed["open"], listed["assign"], listed["by_shared_code"]) == (True, "free", 0)
            (row,) = [each for each in listed["visitors"] if each["name"] == "Ada"]
            assert (row["role"], row["robot"], row["present"]) == ("drive", mine, True)
            assert 0 <= row["present_s"] < 60
            code, out, err = await link("people")
            clock = {time.strftime("%H:%M", time.localtime(time.time() - row["present_s"] - late)) for late in (0, 5)}
            assert (code, err) == (0, "")
            (shown,) = [line.split() for line in out.splitlines() if " Ada " in line]
            assert (shown[:4], shown[4] in clock, shown[5]) == ([str(ada.visitor), "Ada", "driver", name], True, "yes")
            assert await asked("assign", "ada", "--none") == {"visitor": ada.visitor, "name": "Ada", "robot": ""}
            await eventually(lambda: ada.standing.robot == "")

            assert (await link("approve", str(bob.visitor), "--watch"))[:2] == (0, "Bob admitted as watcher\n")
            await eventually(lambda: bob.standing.role is Role.WATCH)
            assert (await asked("approve", "Bob", "--drive"))["approved"][0]["role"] == "drive"
            await eventually(lambda: bob.standing.role is Role.DRIVE)

            # What is refused: 1; what is no command: 2. One line each, and a hint.
            for code, told, words in (
                (1, "no visitor Adda", ("kick", "Adda")),
                (1, "the number of another", ("kick", "1")),
                (1, "no robot 'Nowhere'", ("assign", "Ada", "Nowhere")),
                (1, "Ada has no robot", ("assign", "Ada", "--none")),
                (1, "Ada is not waiting", ("approve", "Ada")),
                (2, "either NAME or --everybody", ("kick",)),
                (2, "either NAME or --everybody", ("kick", "Ada", "--everybody")),
                (2, "--everybody with --watch", ("approve", "--everybody", "--watch")),
                (2, "either ROBOT or --none", ("assign", "Ada")),
            ):
                got, out, err = await link(*words)
                lines = err.splitlines()
                assert (got, out) == (code, ""), err
                assert told in lines[0], err
                assert len(lines) - any("hint" in line for line in lines) == 1
            assert "did you mean Ada?" in (await link("kick", "Adda"))[2]

            code, out, err = await link("kick", "Ada")
            assert (code, "the screen's code are invalid now" in out, "wait" in err) == (0, True, True)
            await eventually(lambda: ada.ended is EndReason.REMOVED)
        async with by_code(ready["qr_url"], "Ada") as again:
            await eventually(lambda: again.ws.closed)  # as `kick` says

        async with visitor("Eve") as eve, visitor("Fay") as fay:
            assert (eve.standing.waiting, fay.standing.waiting) == (True, True)
            assert "Eve" in [each["name"] for each in (await asked("people"))["visitors"] if each["waiting"]]
            assert (await asked("approve", "Eve", "--watch"))["approved"][0]["role"] == "watch"
            await eventually(lambda: not eve.standing.waiting)
            assert eve.standing.role is Role.WATCH
            assert (await link("assign", "Eve", name))[0] == 1, "who watches is given no robot"
            assert [each["name"] for each in (await asked("approve", "--everybody"))["approved"]] == ["Fay"]
            await eventually(lambda: not fay.standing.waiting)
            async with visitor("Guy") as guy:
                assert not guy.standing.waiting, "the door is open"
                gone = await asked("kick", "--everybody")
                assert (gone["code_valid_s"], gone["open"]) == (0, False)
                assert {"Eve", "Fay", "Guy"} <= {each["name"] for each in gone["removed"]}
                await eventually(lambda: all(each.ended for each in (eve, fay, guy)))
        assert (await asked("people"))["visitors"] == []


async def test_what_a_command_cannot_do_is_said(monkeypatch):
    visitor = {"visitor": 3, "name": "Ada", "role": "drive", "waiting": False, "robot": "A1", "present_s": None}
    session = {"visitors": [visitor], "open": True, "assign": "one-each", "shared_code": True}
    told = {"session": session, "visitors": [{"id": "visitor 1a2b3c"}], "robots": []}
    monkeypatch.setattr("phalanx.cli.people.ask_gateway", lambda *_: told)
    code, _, err = await link("assign", "Ada", "--none")
    assert (code, "a robot again" in err, "approve --watch Ada" in err) == (1, True, True)
    assert "with the shared code of --qrkey cannot be removed" in (await link("kick", "Ada"))[2]
    assert (await asked("people"))["by_shared_code"] == 1


async def test_the_projector_lists_visitors_and_who_gets_which_robot_next_and_no_operator():
    swarm, visitors = Dotbots(2, 1, time.time), ("Ada", "Bob", "Dan", "Eve", "Fay")
    async with serving(swarm, assign="one-each", turn_ms=60_000) as link:
        desk = OperatorDesk(link, swarm, link.gateway.brakes, "http://x/", print)
        shown = SimpleNamespace(link=link, gateway=link.gateway, desk=desk, page_url="http://x/", qr_url="http://x/#j=")
        ticket = parse_invitation(desk.do("invite", {"role": "operate"})["url"])
        async with AsyncExitStack() as here:
            for invitation, name in ((ticket, "Op"), *((link.invitation, name) for name in visitors)):
                visit = await here.enter_async_context(visiting(link.port, invitation, name))
                await eventually(lambda visit=visit: visit.frames)
            told, robots = Projector(shown, "", None).state(), [robot.name for robot in swarm.robots()]
            assert [(each["name"], each["robot"]) for each in told["visitors"]] == [
                *zip(visitors, (*robots, "", "", ""), strict=True)
            ]
            assert [(each["name"], each["robot"]) for each in told["queue"]] == [
                *zip(visitors[2:], (*robots, ""), strict=True)
            ]
            assert 50 < told["queue"][0]["left_s"] <= told["queue"][1]["left_s"] <= 60
            assert told["queue"][2]["left_s"] == 0
