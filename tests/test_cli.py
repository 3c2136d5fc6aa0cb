"""The commands as people run them: as children, with signals, on taken ports, with wrong words."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

import click
import paho.mqtt.publish as publish
import pytest
from click.testing import CliRunner

from conftest import PHALANX, ROOT, a_gateway, bare_mosquitto, child, secrets_of
from phalanx.cli.link import _find
from phalanx.cli.main import phalanx
from phalanx.cli.terminal import qr_text
from phalanx.errors import Unavailable, UsageError
from phalanx.gateway.up import for_at_most
from phalanx.io import Client, Server
from phalanx.io.ports import free_port


def run(*arguments: str, timeout_s: float = 60, env: dict | None = None, **more) -> subprocess.CompletedProcess:
    return subprocess.run(
        [*PHALANX, *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=ROOT,
        env=os.environ | (env or {}),
        check=False,
        **more,
    )


def children_of(pid: int) -> list[int]:
    out = subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True, check=False).stdout
    return [int(line) for line in out.split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def open_to_all(pid: int) -> set[int]:
    """TCP ports on which a process or its children listen on every address of this machine, by IPv4 or 6."""
    links = [link for p in (pid, *children_of(pid)) for link in Path(f"/proc/{p}/fd").iterdir()]
    sockets = {str(link.readlink()) for link in links if link.is_symlink()}
    lines = [
        line.split() for table in ("tcp", "tcp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    ]
    listening = [line[1].split(":") for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in sockets]
    assert listening
    return {int(port, 16) for address, port in listening if set(address) == {"0"}}


class TestUp:
    def test_ready_says_everything_and_a_visitor_can_drive(self):
        with a_gateway("--robots", "5", "--seed", "7") as (up, ready):
            assert set(ready) == {
                "event",
                "page_url",
                "qr_url",
                "pin",
                "topic",
                "broker_host",
                "broker_port",
                "broker_ws_port",
                "operator_url",
            }
            assert json.loads(up.out[0]) == ready, "ready is the first event"
            assert re.fullmatch("[0-9]{39}", ready["pin"])
            assert ready["qr_url"].startswith(ready["page_url"] + "#")
            assert "?" not in ready["qr_url"]
            listed = run("link", "connect", ready["qr_url"], "--json")
            assert listed.returncode == 0, listed.stderr
            robots = json.loads(listed.stdout)["robots"]
            assert len(robots) == 5
            address = robots[2]["address"]
            drive = ["--drive", address, "--left", "60", "--right", "60", "--for", "1"]
            drove = json.loads(run("link", "connect", ready["qr_url"], *drive, "--json").stdout)
            assert drove["from"] != drove["to"]
            assert drove["commands"] == 10
            assert up.wait_for("command") == {
                "event": "command",
                "address": address,
                "name": "move_raw",
                "payload": {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60},
            }
            assert up.events("command")[-1]["payload"]["left_y"] == 0, "it ends with a stop"
            name = robots[2]["name"].lower()
            by_name = run("link", "connect", ready["qr_url"], "--drive", name, "--for", "0.1", "--json")
            assert json.loads(by_name.stdout)["address"] == address
            by_pin = run(
                "link", "connect", "--pin", ready["pin"], "--broker", f"localhost:{ready['broker_port']}", "--json"
            )
            assert len(json.loads(by_pin.stdout)["robots"]) == 5
            by_stdin = run("link", "connect", "-", "--json", input=ready["qr_url"] + "\n")
            assert len(json.loads(by_stdin.stdout)["robots"]) == 5
            table = run("link", "connect", ready["qr_url"])
            assert len(table.stdout.splitlines()) == 5

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_it_ends_within_two_seconds_children_included(self, number):
        with a_gateway() as (up, _):
            broker = children_of(up.process.pid)
            assert broker
            began = time.monotonic()
            assert up.stop(number, timeout_s=10) == 0
            assert time.monotonic() - began < 2
            assert not [pid for pid in broker if alive(pid)]
            assert not [line for line in up.err if "Traceback" in line]

    def test_a_gateway_that_is_killed_outright_leaves_no_broker_behind(self):
        with a_gateway() as (up, _):
            broker = children_of(up.process.pid)
            up.stop(signal.SIGKILL)
            deadline = time.monotonic() + 5
            while [pid for pid in broker if alive(pid)]:
                assert time.monotonic() < deadline
                time.sleep(0.05)

    def test_duration_ends_it(self):
        with a_gateway("--duration", "1") as (up, _):
            assert up.wait() == 0

    async def test_only_the_end_of_the_duration_is_the_end_of_the_duration(self):
        async with for_at_most(0.01):
            await asyncio.sleep(60)
        for duration_s in (None, 60):
            with pytest.raises(TimeoutError, match="a socket's"):
                async with for_at_most(duration_s):
                    raise TimeoutError("a socket's")

    def test_rotations_and_rejections_are_told(self):
        with a_gateway("--rotate-s", "16", "--overlap-s", "1") as (up, ready):
            wrong = run("link", "connect", ready["qr_url"], "--drive", "FFFF", "--for", "0.1")
            assert (wrong.returncode, "Traceback" in wrong.stderr) == (1, False)
            assert "no robot FFFF" in wrong.stderr
            rotated = up.wait_for("rotation", timeout_s=30)
            assert rotated["pin"] != ready["pin"]
            assert rotated["pin"] in rotated["qr_url"]
            # One rotation late: led on by the old epoch (ADR 0004). First, for it is the one that must not be two late.
            assert run("link", "connect", ready["qr_url"], "--json").returncode == 0
            assert run("link", "connect", rotated["qr_url"], "--json").returncode == 0
            host, port = ready["broker_host"], ready["broker_port"]
            publish.single(f"/qrkey/{up.events('rotation')[-1]['topic']}/request", b"x", hostname=host, port=port)
            assert up.wait_for("rejected") == {"event": "rejected", "reason": "malformed_jwe", "count": 1}

    def test_two_robots_of_one_name_are_told_apart_by_address_only(self):
        swarm = [{"address": "A1", "name": "Ada"}, {"address": "A2", "name": "ADA"}, {"address": "ADA", "name": "Bo"}]
        assert _find(swarm, "ada")["address"] == "ADA", "an address comes first"
        with pytest.raises(UsageError, match="2 robots are called Ada"):
            _find(swarm[:2], "Ada")
        with pytest.raises(Unavailable, match="no robot None"):
            _find([{"address": "A1", "name": None}], "None")

    def test_with_amqtt(self):
        with a_gateway("--broker", "amqtt") as (up, ready):
            assert not children_of(up.process.pid)
            listed = run("link", "connect", ready["qr_url"], "--json")
            assert len(json.loads(listed.stdout)["robots"]) == 12
            assert up.stop() == 0

    def test_without_a_broker_it_waits_says_so_and_comes_up(self, tmp_path):
        tcp = free_port()
        ws = tcp + 1
        with (
            bare_mosquitto(tcp, ws, tmp_path) as (start, _),
            child("up", "--events", "--port", "0", "--broker", f"mqtt://127.0.0.1:{tcp}") as up,
        ):
            waiting = up.wait_for("waiting")
            assert waiting["broker"] == f"mqtt://127.0.0.1:{tcp}"
            start()
            ready = up.wait_for("ready")
            assert (ready["broker_port"], ready["broker_ws_port"]) == (tcp, ws)
            assert run("link", "connect", ready["qr_url"], "--json").returncode == 0
            assert up.stop() == 0

    def test_a_guess_of_the_brokers_websockets_that_is_wrong_is_told_once(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            start()
            for words in (["up", "--port", "0", "--defence", "none"], ["link", "serve"]):
                with child(*words, "--events", "--broker", f"mqtt://127.0.0.1:{tcp}") as guessing:
                    guessing.wait_for("ready")
                    assert guessing.stop() == 0
                    (line,) = guessing.err
                    assert f"nothing listens at ws://127.0.0.1:{tcp + 1}/mqtt" in line
                    assert "hint: --broker-ws" in line
                there = f"ws://127.0.0.1:{ws}/mqtt"
                with child(*words, "--events", "--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", there) as told:
                    told.wait_for("ready")
                    assert told.stop() == 0
                    assert not told.err

    def test_foreign_pages_get_the_published_form(self):
        with a_gateway("--frontend", "https://dotbots.example/PyDotBot", "--root", "/pydotbot") as (_, ready):
            assert ready["qr_url"].startswith("https://dotbots.example/PyDotBot?use_qrkey=true&pin=")
            listed = run("link", "connect", ready["qr_url"], "--root", "/pydotbot", "--json")
            assert len(json.loads(listed.stdout)["robots"]) == 12

    @pytest.mark.parametrize("broker", ["mosquitto", "amqtt"])
    def test_on_every_address_only_pages_and_websockets_are_open(self, broker):
        with a_gateway("--host", "0.0.0.0", "--broker", broker) as (up, ready):
            page = int(ready["page_url"].rstrip("/").rsplit(":", 1)[1])
            assert open_to_all(up.process.pid) == {page, ready["broker_ws_port"]}

    @pytest.mark.parametrize("broker", ["mosquitto", "amqtt"])
    def test_unless_asked_nothing_is_open_to_other_machines(self, broker):
        with a_gateway("--broker", broker) as (up, ready):
            assert not open_to_all(up.process.pid)
            assert run("link", "connect", ready["qr_url"], "--json").returncode == 0

    def test_the_operators_api_asks_for_the_token_and_never_shows_it(self):
        with a_gateway() as (_, ready):
            address, token = ready["operator_url"].split("/#token=")
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(f"{address}/api/state")
            assert refused.value.code == 401
            request = urllib.request.Request(f"{address}/api/state", headers={"Authorization": f"Bearer {token}"})
            state = json.load(urllib.request.urlopen(request))
            assert state["qr_url"] == ready["qr_url"]
            assert len(state["robots"]) == 12
            assert state["broker"] == {
                "name": "mosquitto",
                "url": f"mqtt://127.0.0.1:{ready['broker_port']}",
                "connected": True,
            }
            assert "<svg" in state["qr_svg"]
            assert token not in json.dumps(state)

    def test_nothing_secret_is_logged_at_debug(self):
        with child(
            "--log-level", "debug", "up", "--events", "--port", "0", "--rotate-s", "8", "--overlap-s", "1"
        ) as up:
            ready = up.wait_for("ready")
            drive = ("--drive", "DECAFBAD00000001", "--left", "33", "--for", "0.3")
            assert run("link", "connect", ready["qr_url"], *drive).returncode == 0
            up.wait_for("rotation")
            up.stop()
            log = "\n".join(up.err)
            assert "connected to mqtt://" in log, "the log was really at DEBUG"
            for secret in [*secrets_of(ready), *(event["pin"] for event in up.events("rotation"))]:
                assert secret not in log

    @pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
    def test_for_people_it_shows_a_code_and_the_addresses(self, host):
        with child("up", "--port", "0", "--host", host, "--duration", "4") as up:
            assert up.wait() == 0
            height = sum(max(1, -(-len(line) // 80)) for line in up.out) + 1  # and the status line
            assert height <= 24, up.out
            text = "\n".join(up.out)
            assert "█" in text
            assert "\x1b" not in text, "no colours in a file"
            assert re.search(r"visitors.*  http://[0-9.]+:\d+/#v=1&pin=", text)
            assert ("--host 0.0.0.0" in text) == (host == "127.0.0.1")
            assert re.search(r"operator  http://127.0.0.1:\d+/#token=", text)


class TestMistakes:
    @pytest.mark.parametrize(
        ("arguments", "code", "words"),
        [
            (["up", "--robots", "0"], 2, "a swarm of 0 robots"),
            (["up", "--robots", "many"], 2, "--robots"),
            (["up", "--pin-digits", "3"], 2, "pin of 3 digits"),
            (["up", "--rotate-s", "5", "--overlap-s", "6"], 2, "overlap of 6 s"),
            (["up", "--rotate-s", "nan"], 2, "rotate_s"),
            (["up", "--root", "noslash"], 2, "root 'noslash'"),
            (["up", "--broker", "http://x"], 2, "http:// is not known"),
            (["up", "--broker", "mqtt://u:hunter2@x"], 2, "has a login in it"),
            (["up", "--broker-login", "/nowhere"], 2, "cannot read /nowhere"),
            (["up", "--port", "99999"], 2, "--port"),
            (["up", "--host", "203.0.113.9"], 1, "cannot listen on 203.0.113.9"),
            (["up", "--host", "not a host"], 1, "cannot listen on not a host"),
            (["up", "--mode", "session"], 2, "--mode"),
            (["up", "--seed", "-1"], 2, "seed -1"),
            (["up", "--frontend", "javascript:alert(1)"], 2, "is not a page"),
            (["up", "--duration", "0"], 2, "--duration"),
            (["up", "--broker-ws", "ws://x"], 2, "a websocket address for a broker of our own"),
            (["up", "--broker", "mqtt://x", "--broker-ws", "mqtt://x"], 2, "browsers cannot use mqtt://x:1883"),
            (["up", "--page-url", "ftp://x"], 2, "'ftp://x' is not a page"),
            (["up", "--unheard-of"], 2, "--unheard-of"),
            (["nonsense"], 2, "nonsense"),
            (["link", "connect"], 2, "no swarm to visit"),
            (["link", "connect", "http://x/"], 2, "no pin in it"),
            (["link", "connect", "http://x/#v=1&pin=12a&broker=ws://x"], 2, "4 to 64 digits"),
            (["link", "connect", "--pin", "1234"], 2, "no swarm to visit"),
            (
                ["link", "connect", "http://x/#v=1&pin=123456&broker=ws://127.0.0.1:1", "--timeout", "0.5"],
                1,
                "no broker at",
            ),
            (
                ["link", "connect", "--pin", "1234", "--broker", "mqtt://127.0.0.1:1", "--timeout", "0.5"],
                1,
                "no broker at",
            ),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--left", "0"], 2, "without a robot"),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--for", "1"], 2, "without a robot"),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--drive", "A", "--watch"], 2, "--watch"),
            (["link", "serve", "--broker", "mqtt://h/path"], 2, "has no path"),
            (["doctor", "--broker", "mqtt://127.0.0.1:1"], 1, ""),
            (["doctor", "--broker", "gopher://x"], 2, "gopher://"),
        ],
        ids=lambda value: " ".join(value) if isinstance(value, list) else None,
    )
    def test_one_clear_line_and_the_right_exit_code(self, arguments, code, words):
        done = run(*arguments)
        assert done.returncode == code, done.stderr
        assert words in done.stderr
        lines = [
            line for line in done.stderr.splitlines() if not line.startswith(("phalanx: hint:", "phalanx: WARNING"))
        ]
        assert len(lines) <= 1, done.stderr
        assert "Traceback" not in done.stderr
        assert "hunter2" not in done.stderr

    def test_a_port_in_use(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = taken.getsockname()[1]
            done = run("up", "--port", str(port))
        assert done.returncode == 1
        assert f"port {port}" in done.stderr
        assert "hint: " in done.stderr

    def test_a_wrong_login(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path, "allow_anonymous false") as (start, _):
            start()
            time.sleep(0.3)
            login = {"PHALANX_BROKER_USERNAME": "me", "PHALANX_BROKER_PASSWORD": "hunter2"}
            for arguments in (["up", "--port", "0"], ["link", "serve"], ["link", "connect", "--pin", "123456"]):
                done = run(*arguments, "--broker", f"mqtt://127.0.0.1:{tcp}", env=login)
                assert (done.returncode, "hunter2" in done.stderr) == (1, False)
                assert "refused the login" in done.stderr

    def test_a_login_file(self, tmp_path):
        (tmp_path / "login").write_text("no colon\n")
        done = run("up", "--broker-login", str(tmp_path / "login"))
        assert done.returncode == 2
        assert "no colon" not in done.stderr

    def test_whoever_reads_our_output_may_leave(self):
        words = ["up", "--events", "--port", "0", "--rotate-s", "1", "--overlap-s", "0.5", "--duration", "60"]
        with subprocess.Popen(
            [*PHALANX, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
        ) as up:
            try:
                assert json.loads(up.stdout.readline())["event"] == "ready"
                up.stdout.close()
                up.wait(20)  # or TimeoutExpired: long before its duration is over
                assert "Traceback" not in up.stderr.read()
            finally:
                up.kill()

    def test_no_command_tells_where_help_is(self):
        done = run()
        assert done.returncode == 2
        assert "up" in done.stdout + done.stderr


class TestHelp:
    def commands(self, command=phalanx, path=()):
        yield path, command
        for name, inner in getattr(command, "commands", {}).items():
            yield from self.commands(inner, (*path, name))

    def test_every_command_has_help_with_an_example(self):
        for path, command in self.commands():
            done = CliRunner().invoke(phalanx, [*path, "--help"])
            assert done.exit_code == 0, path
            assert "Example:" in done.output, path
            for option in command.params:
                if isinstance(option, click.Option):
                    assert option.help, (path, option.name)

    def test_version(self):
        from phalanx import __version__

        assert run("--version").stdout.strip() == f"phalanx {__version__}"


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
            [{"address": "A\x1b[2J", "name": "\x1b]0;x\x07", "lh2_position": {"x": 10**400, "y": None}}],
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


class TestDoctor:
    def test_each_line_is_ok_or_a_fix(self):
        done = run("doctor")
        assert done.returncode == 0, done.stdout
        assert all(line.startswith(("ok ", "fix")) for line in done.stdout.splitlines())
        findings = json.loads(run("doctor", "--json").stdout)["findings"]
        assert {"python", "embedded broker", "pages", "clock"} <= {finding["what"] for finding in findings}

    def test_a_broker_that_is_there_and_one_that_is_not(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            start()
            time.sleep(0.3)
            done = run("doctor", "--broker", f"ws://127.0.0.1:{ws}")
            assert done.returncode == 0
            assert "answers, MQTT 5" in done.stdout
        done = run("doctor", "--broker", f"mqtt://127.0.0.1:{tcp}")
        assert done.returncode == 1
        assert any(line.startswith("fix") and "broker" in line for line in done.stdout.splitlines())


@pytest.mark.parametrize("colour", [True, False])
def test_the_terminals_code_is_the_code(colour):
    """Read it back with another program: first the terminal's cells to pixels, then zxing."""
    import numpy as np
    import zxingcpp

    url = "http://192.168.100.100:8080/#v=1&pin=" + "7" * 39 + "&broker=ws%3A%2F%2F192.168.100.100%3A9001%2Fmqtt"
    light = {"█": (1, 1), "▀": (1, 0), "▄": (0, 1), " ": (0, 0)}
    rows = []
    for line in qr_text(url, border=4, colour=colour).splitlines():
        if colour:
            cells = [(t == "231", b == "231") for t, b in re.findall(r"38;5;(\d+);48;5;(\d+)m▀", line)]
        else:
            cells = [light[letter] for letter in line]
        rows += [[top for top, _ in cells], [bottom for _, bottom in cells]]
    picture = np.kron(np.array(rows, dtype=np.uint8) * 255, np.ones((8, 8), dtype=np.uint8))
    (found,) = zxingcpp.read_barcodes(picture)
    assert found.text == url
    assert len(qr_text(url, border=1, colour=False).splitlines()) == 20, "it fits an ordinary terminal"
