"""`phalanx up` as people run it: as a child, with signals, with brokers that come and go."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import paho.mqtt.publish as publish
import pytest

from brokers import bare_mosquitto
from commands import ROOT, a_gateway, called, child, run, secrets_of
from operator_api import asked, state_of
from phalanx.cli import up as command
from phalanx.gateway.serving import for_at_most
from ports import free_port

pytestmark = pytest.mark.waits


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
        with a_gateway("--robots", "5", "--seed", "7", qrkey=True, fresh=True) as (up, ready):
            assert set(ready) == {
                "event",
                "page_url",
                "qr_url",
                "qrkey_url",
                "pin",
                "topic",
                "session_url",
                "broker_host",
                "broker_port",
                "broker_ws_port",
                "operator_url",
                "projector_url",
                "unreachable",
            }
            assert json.loads(up.out[0])["event"] == "ready", "ready is the first event"
            assert re.fullmatch("[0-9]{39}", ready["pin"])
            assert ready["qr_url"] == ready["session_url"]
            for url in (ready["qr_url"], ready["qrkey_url"]):
                assert url.startswith(ready["page_url"] + "#")
                assert "?" not in url
            listed = run("link", "connect", ready["qrkey_url"], "--json")
            assert listed.returncode == 0, listed.stderr
            robots = json.loads(listed.stdout)["robots"]
            assert len(robots) == 5
            address = robots[2]["address"]
            drive = ["--drive", address, "--left", "60", "--right", "60", "--for", "1"]
            drove = json.loads(called("link", "connect", ready["qrkey_url"], *drive, "--json").stdout)
            assert drove["from"] != drove["to"]
            assert drove["commands"] == 10
            assert up.wait_for("command") == {
                "event": "command",
                "address": address,
                "name": "move_raw",
                "payload": {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60},
            }
            # Ten commands and the stop, each told by a process that may be late.
            assert up.wait_for("command", count=11)["payload"]["left_y"] == 0, "it ends with a stop"
            name = robots[2]["name"].lower()
            by_name = called("link", "connect", ready["qrkey_url"], "--drive", name, "--for", "0.1", "--json")
            assert json.loads(by_name.stdout)["address"] == address
            by_pin = called(
                "link", "connect", "--pin", ready["pin"], "--broker", f"localhost:{ready['broker_port']}", "--json"
            )
            assert len(json.loads(by_pin.stdout)["robots"]) == 5
            by_stdin = run("link", "connect", "-", "--json", input=ready["qrkey_url"] + "\n")
            assert len(json.loads(by_stdin.stdout)["robots"]) == 5
            table = called("link", "connect", ready["qrkey_url"])
            assert len(table.stdout.splitlines()) == 5

    @pytest.mark.alone
    @pytest.mark.parametrize(
        ("number", "defence"), [(signal.SIGINT, "none"), (signal.SIGTERM, "none"), (signal.SIGINT, "hardened")]
    )
    def test_it_ends_within_two_seconds_children_included(self, number, defence):
        with a_gateway("--defence", defence) as (up, _):
            broker = children_of(up.process.pid)
            assert broker
            began = time.monotonic()
            assert up.stop(number, timeout_s=10) == 0
            assert time.monotonic() - began < 2
            assert not [pid for pid in broker if alive(pid)]
            assert not [line for line in up.err if "Traceback" in line]

    def test_a_gateway_that_is_killed_outright_leaves_no_broker_behind(self):
        with a_gateway("--broker", "mosquitto") as (up, _):
            broker = children_of(up.process.pid)
            up.stop(signal.SIGKILL)
            deadline = time.monotonic() + 5
            while [pid for pid in broker if alive(pid)]:
                assert time.monotonic() < deadline
                time.sleep(0.05)

    async def test_only_the_end_of_the_duration_is_the_end_of_the_duration(self):
        async with for_at_most(0.01):
            await asyncio.sleep(60)
        for duration_s in (None, 60):
            with pytest.raises(TimeoutError, match="a socket's"):
                async with for_at_most(duration_s):
                    raise TimeoutError("a socket's")

    def test_rotations_and_rejections_are_told_and_nothing_secret_is_logged_at_debug(self):
        with child(
            *("--log-level", "debug", "up", "--events", "--port", "0", "--defence", "none"),
            *("--rotate-s", "16", "--overlap-s", "1", "--broker", "mosquitto", "--qrkey"),
        ) as up:
            ready = up.wait_for("ready")
            drive = ("--drive", "DECAFBAD00000001", "--left", "33", "--for", "0.3")
            assert called("link", "connect", ready["qrkey_url"], *drive).returncode == 0
            wrong = called("link", "connect", ready["qrkey_url"], "--drive", "FFFF", "--for", "0.1")
            assert (wrong.returncode, "Traceback" in wrong.stderr) == (1, False)
            assert "no robot FFFF" in wrong.stderr
            rotated = up.wait_for("rotation")
            assert rotated["pin"] != ready["pin"]
            assert rotated["pin"] in rotated["qrkey_url"]
            # One rotation late: led on by the old epoch (ADR 0004). First, for it is the one that must not be two late.
            assert called("link", "connect", ready["qrkey_url"], "--json").returncode == 0
            assert called("link", "connect", rotated["qrkey_url"], "--json").returncode == 0
            host, port = ready["broker_host"], ready["broker_port"]
            publish.single(f"/qrkey/{up.events('rotation')[-1]['topic']}/request", b"x", hostname=host, port=port)
            assert up.wait_for("rejected") == {"event": "rejected", "reason": "malformed_jwe", "count": 1}
            up.stop()
            log = "\n".join(up.err)
            assert "connected to mqtt://" in log, "the log was really at DEBUG"
            fragment = ready["session_url"].partition("#j=")[2]
            for secret in [*secrets_of(ready), fragment, *(event["pin"] for event in up.events("rotation"))]:
                assert secret not in log

    def test_without_a_broker_it_waits_says_so_and_comes_up(self, tmp_path):
        tcp = free_port()
        ws = tcp + 1
        with (
            bare_mosquitto(tcp, ws, tmp_path) as (start, _),
            child(
                *("up", "--events", "--port", "0", "--defence", "none", "--qrkey"),
                *("--broker", f"mqtt://127.0.0.1:{tcp}"),
                stdin=subprocess.PIPE,
            ) as up,
        ):
            waiting = up.wait_for("waiting")
            assert waiting["broker"] == f"mqtt://127.0.0.1:{tcp}"
            up.process.stdin.write("stop\n")
            up.process.stdin.flush()
            up.wait_for("held")  # nobody started the broker yet
            start()
            ready = up.wait_for("ready")
            up.wait_for("held", count=2)
            assert (ready["broker_port"], ready["broker_ws_port"]) == (tcp, ws)
            assert called("link", "connect", ready["qrkey_url"], "--json").returncode == 0
            assert up.stop() == 0

    def test_a_broker_that_never_comes_is_one_line_and_a_hint(self):
        ended = run(
            "up", "--wait", "2", "--port", "0", "--defence", "none", "--qrkey", "--broker", "mqtt://127.0.0.1:1"
        )
        assert ended.returncode == 1
        error, hint = ended.stderr.splitlines()
        assert error == "phalanx: error: no broker at mqtt://127.0.0.1:1 within 2 s (connection refused)"
        assert "phalanx doctor" in hint

    @pytest.mark.parametrize(("held", "connected"), [(False, True), (True, True), (True, False)])
    async def test_the_status_line_fits_a_small_terminal(self, monkeypatch, held, connected):
        shown = []
        monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
        monkeypatch.setattr("shutil.get_terminal_size", lambda *_, **__: os.terminal_size((80, 24)))
        monkeypatch.setattr("click.echo", lambda words, **_: shown.append(words.removeprefix("\r\x1b[2K")))
        counts = dict.fromkeys(("visitors", "refused", "robots", "commands"), 12345)
        now = {
            "held": held,
            "connected": connected,
            "rotates_in_s": 899.0,
            **counts,
        }
        status = asyncio.ensure_future(command._keep_status(SimpleNamespace(summary=lambda: now)))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        status.cancel()
        (line,) = shown
        assert len(line) <= 79
        assert ("ALL STOPPED: go and Enter" if held else "Enter: stop all") in line
        assert ("broker unreachable" in line) == (not connected)
        for count in re.findall("12345.*", line.replace("  ", "\n")):
            assert count.removeprefix("12345 ") in counts, "whole words only"

    def test_foreign_pages_get_the_published_form(self):
        with a_gateway("--frontend", "https://dotbots.example/PyDotBot", "--root", "/pydotbot", qrkey=True) as (
            _,
            ready,
        ):
            assert ready["qr_url"].startswith("https://dotbots.example/PyDotBot?use_qrkey=true&pin=")
            listed = called("link", "connect", ready["qr_url"], "--root", "/pydotbot", "--json")
            assert len(json.loads(listed.stdout)["robots"]) == 12

    @pytest.mark.parametrize("qrkey", [True, False])
    def test_on_every_address_only_pages_and_websockets_are_open(self, qrkey):
        with a_gateway("--host", "0.0.0.0", qrkey=qrkey) as (up, ready):
            page = int(ready["page_url"].rstrip("/").rsplit(":", 1)[1])
            assert open_to_all(up.process.pid) == {page, ready.get("broker_ws_port", page)}

    @pytest.mark.parametrize("qrkey", [True, False])
    def test_unless_asked_nothing_is_open_to_other_machines(self, qrkey):
        with a_gateway(qrkey=qrkey) as (up, ready):
            assert len(children_of(up.process.pid)) == (2 if qrkey else 1), "the front end; the broker"
            assert not open_to_all(up.process.pid)
            if qrkey:
                listed = called("link", "connect", ready["qr_url"], "--json")
                assert len(json.loads(listed.stdout)["robots"]) == 12
                self.asks_for_the_token(ready)
            assert up.stop() == 0

    def asks_for_the_token(self, ready):
        """The operator's API asks for it, and never shows it."""
        assert asked(ready, "state", token="")[0] == 401
        state = state_of(ready)
        assert state["qr_url"] == ready["qr_url"]
        assert len(state["robots"]) == 12
        assert state["broker"] == {
            "name": "mosquitto",
            "url": f"mqtt://127.0.0.1:{ready['broker_port']}",
            "connected": True,
            "trouble": "",
            "phones": "",
        }
        assert "<svg" in state["qr_svg"]
        assert ready["operator_url"].partition("#token=")[2] not in json.dumps(state)

    @pytest.mark.parametrize(
        ("host", "defence", "more", "code"),
        [
            ("127.0.0.1", "hardened", (), "j="),
            ("0.0.0.0", "none", (), "j="),
            ("127.0.0.1", "none", ("--broker", "mosquitto", "--qrkey"), "j="),
        ],
    )
    def test_for_people_it_shows_a_code_and_the_addresses(self, host, defence, more, code):
        with child("up", "--port", "0", "--host", host, "--defence", defence, "--duration", "4", *more) as up:
            assert up.wait() == 0
            height = sum(max(1, -(-len(line) // 80)) for line in up.out) + 1  # and the status line
            # A broker's URL makes the code larger than a terminal of 24 lines.
            assert height <= (32 if "--broker" in more else 24), up.out
            text = "\n".join(up.out)
            assert "█" in text
            assert "\x1b" not in text, "no colours in a file"
            assert re.search(rf"visitors.*  http://[0-9.]+:\d+/#{code}", text)
            assert ("--host 0.0.0.0" in text) == (host == "127.0.0.1")
            assert re.search(r"operator  http://127.0.0.1:\d+/#token=", text)


@pytest.mark.parametrize("file", ["phalanx.service", "Containerfile"])
def test_what_we_deploy_starts_a_gateway_in_words_that_it_knows(file):
    text = (ROOT / "deploy" / file).read_text().replace("\\\n", " ")
    found = re.search(r"^(ENTRYPOINT |ExecStart=\S+/)(.*phalanx.*)$", text, re.MULTILINE)[2]
    command, *words = re.findall(r"[^\s\[\]\",]+", found)
    assert command == "phalanx"
    done = run(*words, "--help")
    assert done.returncode == 0, done.stderr
    assert "--host" in done.stdout


def test_tablet_and_enter_shows_a_code_that_makes_a_tablet_an_operators(state):
    ours, theirs = os.openpty()
    command = [sys.executable, "-m", "phalanx", "up", "--port", "0", "--robots", "2", "--defence", "none"]
    with subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as up:
        try:
            next(line for line in up.stdout if line.startswith("operator  "))
            os.write(ours, b"tablet\n")
            shown = next(line for line in up.stdout if line.startswith("operator's tablet"))
            assert re.search(r"http://127\.0\.0\.1:\d+/operator/#j=[\w-]+$", shown)
        finally:
            up.terminate()
            os.close(ours)
            os.close(theirs)


def test_ports_that_are_taken_are_told_in_one_line_each():
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # somebody else has it
            stack.enter_context(socket.create_server(("127.0.0.1", 8080)))
        taken = str(stack.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1])
        moved = called("up", "--events", "--defence", "none", "--duration", "0.1")
        assert moved.returncode == 0
        (line,) = moved.stderr.splitlines()
        assert re.fullmatch(r"phalanx: warning: \S+ port 8080 is in use: using \d+ instead", line)
        for option, words in (("--port", ()), ("--operator-port", ("--port", "0"))):
            refused = called("up", "--events", "--defence", "none", option, taken, *words)
            assert (refused.returncode, refused.stdout) == (1, "")
            assert refused.stderr.splitlines() == [
                f"phalanx: error: cannot listen on 127.0.0.1 port {taken}: Address already in use",
                f"phalanx: hint: another program uses it: choose another with {option}, or {option} 0 for any",
            ]
