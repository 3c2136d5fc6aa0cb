"""Robots stop, whatever becomes of the event loop and of the broker."""

from __future__ import annotations

import asyncio
import json
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import asynccontextmanager
from urllib.parse import urlsplit

import pytest

from brokers import bare_mosquitto
from commands import a_gateway, run
from phalanx.errors import Held
from phalanx.gateway import Gateway
from phalanx.gateway.brakes import Brakes, KeptStop
from phalanx.gateway.up import UpOptions, up
from phalanx.net import Client, QrkeyClient, Server
from phalanx.net.ports import is_free
from phalanx.net.site import serve_in_thread
from phalanx.world import Dotbots
from ports import free_port
from served_pages import operator_pages
from waiting import eventually

pytestmark = pytest.mark.waits

TOKEN = "t0ken" * 6
# Measured: 0.02 to 0.1 s. What is left is for a machine that does much beside.
STOPPED_WITHIN_S = 1.0
SPIN = {"left_y": 30, "right_y": -30}


class Real(Dotbots):
    """Robots that move by themselves, as real ones do: no event loop has to turn for it."""

    def __enter__(self):
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.live)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()

    def live(self):
        while not self.over.wait(0.02):
            self.step(0.02)

    def how_they_stand(self):
        return [(robot.at, robot.direction_deg, bool(robot.route)) for robot in self.robots()]


def say(url: str, what: str, token: str = TOKEN) -> dict:
    """POST what the operator's page of this machine does; or read the state."""
    path = "link/state" if what == "state" else what
    headers = {"Authorization": f"Bearer {token}"}
    with urllib.request.urlopen(urllib.request.Request(f"{url}/api/{path}", b"{}", headers), timeout=5) as answer:
        return json.loads(answer.read())


def hold_up_the_event_loop(for_s: float, busy_s: float):
    """For a part of it as whoever computes does, not as whoever waits."""
    until_s = time.monotonic() + busy_s
    while time.monotonic() < until_s:
        pass
    time.sleep(for_s - busy_s)


@asynccontextmanager
async def served(swarm, broker):
    async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
        gateway = Gateway(swarm, server)
        job = asyncio.create_task(gateway.run())
        await server.wait_connected(10)
        async with QrkeyClient(server.qr()) as visitor:
            gateway.rejected = lambda: server.rejected  # for tests
            yield gateway, visitor
        job.cancel()


class TestWithTheEventLoopHeldUp:
    @pytest.mark.parametrize("busy_s", [1.0, pytest.param(10.0, marks=pytest.mark.long)])
    async def test_who_was_driven_stands_still_for_the_ten_seconds(self, broker, busy_s):
        with Real(1, 1, time.time) as swarm:
            address = swarm.robots()[0].address
            async with served(swarm, broker) as (_, visitor):
                before = swarm.how_they_stand()
                await visitor.command(address, "move_raw", SPIN)
                await eventually(lambda: swarm.how_they_stand() != before, every_s=0.005)
                hold_up_the_event_loop(1.0, busy_s=1.0)
                stood = swarm.how_they_stand()
                hold_up_the_event_loop(9.0, busy_s=busy_s - 1.0)
                assert swarm.how_they_stand() == stood

    async def test_the_operators_button_stops_all_meanwhile(self, broker):
        with Real(2, 1, time.time) as swarm:
            address = swarm.robots()[0].address
            async with served(swarm, broker) as (gateway, visitor):
                route = [{"x": x, "y": y} for x in (300, 1700) for y in (300, 1700)] * 8
                await visitor.command(address, "waypoints", {"threshold": 50, "waypoints": route})
                await eventually(lambda: swarm.robots()[0].route)

                async with serve_in_thread(operator_pages(TOKEN, hold=gateway.brakes.hold)) as pages:
                    button = threading.Thread(target=say, args=(f"http://127.0.0.1:{pages.port}", "stop"))
                    button.start()
                    hold_up_the_event_loop(STOPPED_WITHIN_S, busy_s=STOPPED_WITHIN_S)
                    stood = swarm.how_they_stand()
                    hold_up_the_event_loop(1.0, busy_s=0.0)
                    assert not button.is_alive()
                    assert swarm.how_they_stand() == stood
                    assert not swarm.robots()[0].route
                    hold_up_the_event_loop(0.5, busy_s=0.0)
                    assert swarm.how_they_stand() == stood
                    # Visitors do not get round it, by no kind of order.
                    async with asyncio.timeout(10):
                        while gateway.rejected()["held"] < 6:
                            await visitor.command(address, "move_raw", SPIN)
                            await visitor.command(address, "waypoints", {"threshold": 50, "waypoints": route[:1]})
                            await asyncio.sleep(0.1)
                    assert swarm.how_they_stand() == stood
                    await asyncio.to_thread(say, f"http://127.0.0.1:{pages.port}", "go")
                    async with asyncio.timeout(10):
                        while swarm.how_they_stand() == stood:
                            await visitor.command(address, "move_raw", SPIN)
                            await asyncio.sleep(0.1)


class TestWithTheBrokerDead:
    def test_the_word_in_the_terminal_and_the_page_stop_all_and_let_them_go(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, kill):
            start()
            where = ("--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", f"ws://127.0.0.1:{ws}/mqtt")
            with a_gateway("--robots", "3", *where, stdin=-1) as (gateway, ready):
                told = urlsplit(ready["operator_url"])
                url, token = f"http://{told.netloc}", told.fragment.removeprefix("token=")

                def routes():
                    return [robot["mode"] for robot in say(url, "state", token)["robots"]]

                def type_in(line):
                    gateway.process.stdin.write(line + "\n")
                    gateway.process.stdin.flush()

                async def drive_all():
                    gone = len(gateway.events("left")) + 1
                    async with Client(ready["qr_url"]) as visitor:
                        around = [{"x": x, "y": y} for x in (300, 1700) for y in (300, 1700)] * 8
                        robots = await visitor.robots()
                        async with asyncio.timeout(10):
                            while routes() != [1, 1, 1]:  # nobody confirms that a command came
                                for robot in robots:
                                    route = {"threshold": 50, "waypoints": around}
                                    await visitor.command(robot["address"], "waypoints", route)
                                await asyncio.sleep(0.1)
                    gateway.wait_for("left", gone)  # with a broker killed before that, it would keep its robot

                asyncio.run(drive_all())
                kill()
                with pytest.raises(urllib.error.HTTPError, match="401"):
                    say(url, "stop", "0" * 32)
                for n, stop in enumerate((lambda: type_in(""), lambda: say(url, "stop", token)), 1):
                    assert routes() == [1, 1, 1]
                    stop()
                    asyncio.run(eventually(lambda: routes() == [0, 0, 0], STOPPED_WITHIN_S))
                    gateway.wait_for("held", n)
                    assert say(url, "state", token)["held"]
                    if n == 1:
                        type_in("go")
                    else:
                        say(url, "go", token)
                    gateway.wait_for("released", n)
                    assert not say(url, "state", token)["held"]
                    start()
                    asyncio.run(drive_all())
                    kill()
                gateway.process.stdin.close()  # whoever typed has gone: that says nothing
                assert gateway.stop() == 0


class TestWithTheBrokerNotThereYet:
    async def test_the_operators_button_is_said_to_every_robot_at_once(self, monkeypatch):
        class Told(Dotbots):
            holds = 0

            def hold(self):
                self.holds += 1

        swarm, port = Told(1, 1, time.time), free_port()
        # The operator's port is the one that visitors' pages like best: theirs goes elsewhere.
        monkeypatch.setattr(sys.modules[up.__module__], "DEFAULT_PORT", port)
        where = f"mqtt://127.0.0.1:{free_port()}"
        options = UpOptions(qrkey=True, broker=where, operator_port=port, operator_token=TOKEN, wait_s=30)
        job = asyncio.create_task(up(options, lambda _: None, swarm=lambda: swarm))
        await eventually(lambda: not is_free(port))
        await asyncio.to_thread(say, f"http://127.0.0.1:{port}", "stop")
        await eventually(lambda: swarm.holds > 2, 3)
        job.cancel()
        await asyncio.wait([job])


class TestBrakes:
    def test_a_driver_that_is_slower_than_its_joystick_is_stopped_after_all(self):
        said = []

        class Slow(Dotbots):
            def drive(self, address, left_pct, right_pct):
                time.sleep(0.5)
                said.append("drive")

            def stop(self, address):
                said.append("stop")

        with Brakes(Slow(1, 1, time.time)) as brakes:
            brakes.drive("DECAFBAD00000001", 50, 50)
        assert said[-2:] == ["drive", "stop"]

    def test_a_driver_that_hangs_holds_up_neither_the_stop_of_the_others_nor_the_end(self):
        class Hung(Dotbots):
            def drive(self, address, left_pct, right_pct):
                if address.endswith("1"):
                    over.wait(20)
                super().drive(address, left_pct, right_pct)

        over, swarm = threading.Event(), Hung(2, 1, time.time)
        one, two = (robot.address for robot in swarm.robots())
        with Brakes(swarm) as brakes:
            brakes.drive(two, 50, 50)
            threading.Thread(target=brakes.drive, args=(one, 50, 50), daemon=True).start()
            asyncio.run(eventually(lambda: two in swarm._to_stop))
        over.set()

    def test_a_joystick_let_go_whose_word_fails_is_stopped_when_its_time_is_up_and_so_is_who_is_driven_at_the_end(self):
        stopped = []

        class Noisy(Dotbots):
            def drive(self, address, left_pct, right_pct):
                if not left_pct:
                    raise OSError("the radio is gone")

            def stop(self, address):
                stopped.append(address[-1])

        with Brakes(Noisy(2, 1, time.time)) as brakes:
            brakes.drive("DECAFBAD00000001", 50, 50)
            with pytest.raises(OSError, match="radio"):
                brakes.drive("DECAFBAD00000001", 0, 0)
            asyncio.run(eventually(lambda: stopped == ["1"]))
            brakes.drive("DECAFBAD00000002", 50, 50)
        assert stopped == ["1", "2"]

    def test_a_hold_that_fails_is_tried_again(self):
        class Deaf(Dotbots):
            tries = 0

            def hold(self):
                self.tries += 1
                if self.tries < 3:
                    raise OSError("the radio is gone")
                super().hold()

        swarm = Deaf(1, 1, time.time)
        with Brakes(swarm) as brakes:
            brakes.hold()
            asyncio.run(eventually(lambda: swarm._held))
            with pytest.raises(Held):
                brakes.drive(swarm.robots()[0].address, 1, 1)
            brakes.drive(swarm.robots()[0].address, 0, 0)
            brakes.hold(False)
            asyncio.run(eventually(lambda: not swarm._held))
            brakes.drive(swarm.robots()[0].address, 1, 1)


def test_a_stop_outlives_a_gateway_that_is_killed(tmp_path):
    token = tmp_path / "token"
    options = ("--operator-port", str(free_port()), "--operator-token-file", str(token), "--robots", "2")
    stopped = tmp_path / "token.stopped"

    def operator(ready: dict) -> tuple[str, str]:
        url, _, said = ready["operator_url"].partition("/#token=")
        return url, said

    with a_gateway(*options) as (gateway, ready):
        url, said = operator(ready)
        assert not say(url, "state", said)["held"]
        say(url, "stop", said)
        gateway.wait_for("held")
        assert stopped.stat().st_mode & 0o777 == 0o600
        gateway.process.kill()
        gateway.wait()
    with a_gateway(*options) as (gateway, ready):
        gateway.wait_for("held")
        assert [line for line in gateway.err if "all robots stay stopped" in line]
        assert say(url, "state", said)["held"]
        robot = say(url, "state", said)["robots"][0]["address"]
        run("link", "connect", ready["qr_url"], "--drive", robot, "--left", "30", "--for", "0.5")
        assert gateway.wait_for("rejected")["reason"] == "held"
        say(url, "go", said)
        gateway.wait_for("released")
        gateway.process.kill()
        gateway.wait()
    assert not stopped.exists()
    with a_gateway(*options):
        assert not say(url, "state", said)["held"]


def test_a_stop_that_cannot_be_kept_is_a_stop_and_is_told(tmp_path, caplog):
    brakes, kept = Brakes(Dotbots(2, 1, time.time)), KeptStop(tmp_path / "no" / "folder")
    brakes.hold()
    kept.keep(lambda: brakes.held)
    assert "a restart will forget" in caplog.text
    # A link that somebody laid there is not followed, and holds.
    (tmp_path / "stopped").symlink_to(tmp_path / "elsewhere")
    laid = KeptStop(tmp_path / "stopped")
    assert laid.was_held()
    laid.keep(lambda: True)
    assert not (tmp_path / "elsewhere").exists()
