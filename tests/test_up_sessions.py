"""`phalanx up` on the direct transport, as people run it: no broker, one port, and a folder that survives."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from commands import a_gateway, called
from phalanx.cli.gateway_of import ask_gateway
from phalanx.errors import UsageError
from phalanx.gateway import UpOptions
from phalanx.gateway.chain_file import read_lines
from phalanx.link.session import Invitation, Reason, parse_invitation
from phalanx.link.session.errors import EndReason
from phalanx.net import QrkeyClient
from phalanx.robot import Led
from phalanx.world import Dotbots
from serving import up_here
from session_front import visiting
from waiting import eventually

pytestmark = pytest.mark.waits


@asynccontextmanager
async def running(**options):
    swarm = Dotbots(3, 1, time.time)
    async with up_here(swarm, **options) as (gateway, ready):
        yield gateway, ready, swarm


def port_of(ready) -> int:
    return int(ready["page_url"].rstrip("/").rpartition(":")[2])


def visit(ready, invitation=None, name=""):
    return visiting(port_of(ready), invitation or parse_invitation(ready["qr_url"]), name)


async def test_the_page_and_its_websocket_are_on_one_port_and_a_robot_is_driven():
    async with running() as (gateway, ready, swarm):
        assert ready["qr_url"].startswith(f"{ready['page_url']}#j=")
        assert "pin" not in ready
        async with visit(ready, name="Ada") as ada:
            await eventually(lambda: ada.frames)
            robot, began = swarm.robots()[0].address, swarm.robots()[0].at
            for _ in range(40):
                await ada.command(robot, "move_raw", {"left_y": 60, "right_y": 60})
                await asyncio.sleep(0.05)
                if swarm.robots()[0].at != began:
                    break
            assert swarm.robots()[0].at != began
            state = gateway.state()
            assert gateway.health() == {"broker": True, "shields": "none"}
            assert state["mode"] == "session"
            assert [each["name"] for each in state["session"]["visitors"]] == ["Ada"]
            assert gateway.summary()["visitors"] == 1
            gateway.desk.do("remove", {"visitor": ada.visitor})
            await eventually(lambda: ada.ended is EndReason.REMOVED)
        async with visit(ready) as again:
            await eventually(lambda: again.ws.closed)
            assert again.visitor is None, "the code has changed"
        async with visit(ready, gateway.link.invitation, "Bob") as bob:
            await eventually(lambda: bob.standing)
            assert bob.standing.waiting, "until an operator lets newcomers in"
            gateway.job.cancel()
            await eventually(lambda: bob.ended is EndReason.CLOSING)


async def test_who_was_removed_stays_removed_after_a_kill_and_who_was_not_comes_back(state):
    with a_gateway("--robots", "2") as (child, ready):
        async with visit(ready, name="Ada") as ada, visit(ready, name="Eve") as eve:
            await eventually(lambda: ada.secret and eve.secret and ada.frames)
            await ada.request("area")
            await eve.request("area")
            await asyncio.to_thread(ask_gateway, None, "link/remove", {"visitor": eve.visitor})
            os.kill(child.process.pid, signal.SIGKILL)
        child.wait()
    with a_gateway("--robots", "2") as (child, ready):
        static = parse_invitation(ready["qr_url"]).static
        async with visit(ready, Invitation(static, ada.secret)) as again:
            await eventually(lambda: again.frames)
            assert (again.visitor, again.name) == (ada.visitor, "Ada")
        async with visit(ready, Invitation(static, eve.secret)) as back:
            await eventually(lambda: back.ws.closed)
            assert back.visitor is None
        assert child.stop() in (0, 1)
    events = [line["event"] for line in read_lines(state / "trail.jsonl")]
    assert events.index("removed") < len(events) - 1
    assert not (state / "operator.json").exists()
    assert {path.stat().st_mode & 0o777 for path in state.iterdir()} == {0o600}
    assert state.stat().st_mode & 0o777 == 0o700


async def test_the_shared_code_commands_no_robot_that_a_visitor_of_a_session_has():
    async with running(broker="mosquitto", qrkey=True) as (gateway, ready, swarm):
        hers, other = (robot.address for robot in swarm.robots()[:2])
        shown = parse_invitation(ready["session_url"])
        red, led = {"red": 9, "green": 0, "blue": 0}, lambda i: swarm.robots()[i].led
        async with visit(ready, Invitation(shown.static, shown.secret), "Ada") as ada:
            await eventually(lambda: ada.frames)
            await ada.command(hers, "move_raw", {"left_y": 1, "right_y": 1})
            await eventually(lambda: ada.standing.robot == hers)
            async with QrkeyClient(ready["qrkey_url"]) as page:
                await page.command(hers, "rgb_led", red)
                await page.command(hers.lower(), "move_raw", {"left_y": 0, "right_y": 0})
                await page.command(other, "rgb_led", red)
                await eventually(lambda: led(1) == Led(9, 0, 0))
                assert led(0) != Led(9, 0, 0)
                assert gateway.shared.server.rejected == {"busy": 2}
                await ada.command(hers, "rgb_led", red)
                await eventually(lambda: led(0) == Led(9, 0, 0))


async def test_a_ticket_from_the_terminal_limits_its_visitor_to_its_robot(tmp_path, state):
    with a_gateway("--robots", "3") as (_, ready):
        robots = (await asyncio.to_thread(ask_gateway, None, "link/state", {}))["robots"]
        mine, other = robots[0], robots[1]
        made = called("link", "invite", "--robot", mine["name"], "--role", "driver", "--name", "Ada")
        assert made.returncode == 0, made.stderr
        ticket = parse_invitation(made.stdout)
        async with visit(ready, ticket) as ada:
            await eventually(lambda: ada.frames)
            assert ada.name == "Ada"
            await ada.command(other["address"], "move_raw", {"left_y": 60, "right_y": 60})
            await eventually(lambda: ada.refused == [(0, Reason.NOT_ALLOWED)])
            await ada.command(mine["address"], "move_raw", {"left_y": 60, "right_y": 60})
            await eventually(lambda: ada.standing.robot == mine["address"])
        async with visit(ready, ticket) as again:
            await eventually(lambda: again.ws.closed)
        sheet = tmp_path / "cards.html"
        made = called("link", "invite", "--sheet", str(sheet))
        assert made.returncode == 0, made.stderr
        assert sheet.read_text().count("<svg") == 3
        assert sheet.stat().st_mode & 0o777 == 0o600
        refused = called("link", "invite", "--robot", "Nobody")
        assert (refused.returncode, "no robot" in refused.stderr) == (1, True)
    trail = called("link", "trail", "verify")
    assert trail.returncode == 0, trail.stderr
    top = trail.stdout.rpartition(" ")[2].strip()
    lines = [json.loads(line) for line in called("link", "trail", "export").stdout.splitlines()]
    assert [line["event"] for line in lines[:4]] == ["invited", "joined", "drives", "left"]
    assert "cannot" not in trail.stderr
    # Lines that are changed, taken out or cut off.
    path = state / "trail.jsonl"
    whole = path.read_bytes().splitlines(keepends=True)
    for spoilt, words in (
        ([whole[0].replace(b"drive", b"watch"), *whole[1:]], ()),
        ([whole[0], *whole[2:]], ()),
        (whole[:-1], ("--top", top)),
    ):
        (tmp_path / "t").write_bytes(b"".join(spoilt))
        assert called("link", "trail", "verify", str(tmp_path / "t"), *words).returncode == 2
    assert called("link", "trail", "verify", "--top", top).returncode == 0
    path.write_bytes(b"".join(whole[:-1]))
    cut = called("link", "trail", "verify")
    assert (cut.returncode, "was cut off" in cut.stderr) == (2, True)


def test_a_second_gateway_runs_beside_the_first_unless_it_was_given_the_same_folder(state):
    with a_gateway():
        with a_gateway() as (second, _):
            assert any("another gateway uses" in line for line in second.err)
        refused = called("up", "--port", "0", "--defence", "none", "--state", str(state))
        assert refused.returncode == 1
        assert "another gateway uses" in refused.stderr


def test_no_gateway_no_ticket(state):
    made = called("link", "invite")
    assert (made.returncode, "no gateway runs" in made.stderr) == (1, True)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("--broker", "auto"), "phalanx up needs no broker"),
        (("--broker", "amqtt", "--qrkey"), "--broker mosquitto"),
        (("--broker-ws", "ws://x"), "--broker mosquitto|URL"),
        (("--root", "/lab"), "--broker mosquitto|URL"),
        (("--qrkey",), "--broker URL, or --broker mosquitto"),
        (("--qrkey", "--broker", "mosquitto", "--assign", "tickets"), "leave one out"),
        (("--rotate-s", "600"), "--qrkey"),
        (("--pin-digits", "12"), "--qrkey"),
        (("--visitors-login", "file"), "visitors connect without a login"),
        (("--frontend", "http://x/"), "--qrkey"),
    ],
)
def test_options_of_mode_qrkey_are_refused_with_the_way_that_there_is_now(words, hint):
    refused = called("up", *words)
    assert refused.returncode == 2
    assert hint in refused.stderr.splitlines()[1]
    assert refused.stderr.splitlines()[1].startswith("phalanx: hint: ")


def test_pages_and_options_that_do_not_go_together():
    with pytest.raises(UsageError, match="both pages"):
        UpOptions(port=8080, operator_port=8080)
    with pytest.raises(UsageError, match="--qrkey without a broker"):
        UpOptions(qrkey=True)
    for assign in ("tickets", "one-each"):
        with pytest.raises(UsageError, match=f"--assign {assign} with --qrkey"):
            UpOptions(qrkey=True, broker="mosquitto", assign=assign)
    assert UpOptions(tls=(Path("c"), Path("k"))).page_at(1) == "https://127.0.0.1:1/"
    assert UpOptions(host="::1").page_at(1) == "http://[::1]:1/"
    assert UpOptions(page_url="https://x/y").page_at(1) == "https://x/y"
    assert UpOptions().session_config().resume_s == 3600
    assert UpOptions(page_url="https://x/y").session_config().resume_s == 8 * 3600
