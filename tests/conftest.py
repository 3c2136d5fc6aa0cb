"""What the tests share: a real broker on free ports, and the command line as a child."""

from __future__ import annotations

import asyncio
import gc
import io
import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import asynccontextmanager, contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from types import SimpleNamespace
from uuid import uuid4

import aiomqtt
import pytest
from hypothesis import HealthCheck, settings

from certificates import make_certificate
from chromium import CHROMIUM, FLAGS
from phalanx.cli.main import run_command
from phalanx.gateway.payloads import check_words
from phalanx.gateway.serve_pages import PAGE_POLICY, PAGES, OperatorPages
from phalanx.net import ANY, Server
from phalanx.net.broker import open_broker
from phalanx.net.ports import listen
from phalanx.net.site import Site
from ports import free_port
from zygote import Forked, is_plain

ROOT = Path(__file__).parent.parent
PHALANX = [sys.executable, "-m", "phalanx"]
# How long an example takes says how busy the machine is.
# Others than the last time: what is rare is found by many runs, and each of them is short.
settings.register_profile("beside others", deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("beside others")
# Whoever runs in the background of a shell does not hear Ctrl-C, nor does any program that is started from there.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def kernel_defects():
    """Log records of checks that failed while kernels read a peer's bytes: a test that clears them not, fails."""
    handler, records, logger = logging.Handler(), [], logging.getLogger("phalanx.kernel")
    handler.emit = records.append
    logger.addHandler(handler)
    yield records
    logger.removeHandler(handler)
    assert not [record.getMessage() for record in records]


@pytest.fixture(autouse=True, scope="session")
def states(tmp_path_factory):
    """A folder below which gateways keep what they keep, and not in somebody's home."""
    folder = tmp_path_factory.mktemp("states")
    os.environ["XDG_STATE_HOME"] = str(folder / "of modules")
    return folder


@pytest.fixture(autouse=True)
def state(states, monkeypatch):
    """One of each test's own: a gateway that another test has left behind has its own."""
    path = states / uuid4().hex
    monkeypatch.setenv("XDG_STATE_HOME", str(path))
    return path / "phalanx"


_running: list[pytest.Item] = []


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    _running[:] = [item]


def in_real_time():
    """Whoever waits beside tests that compute would be late."""
    marks = {mark.name for mark in _running[0].iter_markers()}
    assert marks & {"waits", "alone"}, "mark this test as one that `waits` (CONTRIBUTING.md)"


@asynccontextmanager
async def a_broker():
    """A mosquitto of ours on free ports."""
    in_real_time()
    async with open_broker("mosquitto", tcp_port=free_port(), ws_port=free_port()) as broker:
        yield broker


def a_server(broker, **more) -> Server:
    """A server that keeps what it hears, and answers request 0."""
    server = Server(broker.url, broker_for_visitors=broker.websocket, **more)
    server.heard = []

    @server.on_command(ANY)
    def hear(command):
        server.heard.append((command.address, command.name, command.payload))

    @server.on_request(0)
    async def answer(request):
        return {"asked": request.words.get("what"), "robots": [1, 2]}

    return server


def somebody(broker) -> aiomqtt.Client:
    """A connection of whoever reaches the broker."""
    return aiomqtt.Client(broker.url.host, broker.url.port)


def a_page(port: int = 0, host: str = "127.0.0.1", connections: int = 1000) -> Site:
    """The visitors' page, served in this process."""
    return Site(PAGES / "visitor", PAGE_POLICY, connections=connections, doors=[listen(host, port, "--port")])


def operator_pages(token: str, state=dict, port: int = 0, **said) -> OperatorPages:
    """The operator's page of a gateway that does nothing but what is `said`."""

    async def ask(what, words):
        return state() if what == "state" else check_words(words)

    desk = SimpleNamespace(ask=ask)
    running = SimpleNamespace(hold=said.get("hold", lambda _: None), desk=desk, health=said.get("health"))
    return OperatorPages(token, running, port)


async def tell_until_cancelled(server):
    """Notify everybody, ten times a second."""
    while True:
        await server.notify({"cmd": 1})
        await asyncio.sleep(0.1)


@pytest.fixture
async def broker():
    async with a_broker() as running:
        yield running


@contextmanager
def bare_mosquitto(tcp_port: int, ws_port: int, folder: Path, *more: str):
    """A mosquitto that nobody supervises: a broker of somebody else's. Yields a way to start and kill it."""
    config = folder / f"mosquitto-{tcp_port}.conf"
    lines = ["persistence false", *(more or ["allow_anonymous true"])]
    config.write_text(
        "\n".join(
            [*lines, f"listener {tcp_port} 127.0.0.1", f"listener {ws_port} 127.0.0.1", "protocol websockets", ""]
        )
    )
    in_real_time()
    running: list[subprocess.Popen] = []

    def start():
        env = os.environ | {"PATH": os.environ["PATH"] + ":/usr/sbin"}
        command = ["mosquitto", "-c", str(config)]
        # A port that was free may be some connection's by now, for a while.
        for _ in range(20):
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
            while process.poll() is None:
                with suppress(OSError), socket.create_connection(("127.0.0.1", ws_port)):  # the last that it opens
                    running.append(process)
                    return
                time.sleep(0.02)
            time.sleep(0.25)
        raise AssertionError(f"no mosquitto at {tcp_port} and {ws_port}")

    def kill():
        while running:
            process = running.pop()
            process.send_signal(signal.SIGKILL)
            process.wait()

    try:
        yield start, kill
    finally:
        kill()


def with_an_old_pin(server, age_s: float):
    """`server`, whose first pin is `age_s` old when the broker is reached: one rotation is near, the next one far.

    With a short rotation instead, a busy machine would be given two where the test means one.
    """
    begin = server._side.restart_clock
    server._side.restart_clock = lambda uptime_s: begin(uptime_s - age_s)
    return server


async def eventually(condition, timeout_s: float = 10.0, every_s: float = 0.02):
    """Wait until `condition()` is true, and say which one never was."""
    deadline = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout_s} s: {getattr(condition, '__name__', condition)}"
        await asyncio.sleep(every_s)
    return value


class Turns:
    """The longest turn of this event loop, in seconds of processor time: what others do with the machine is not in it."""

    def __init__(self) -> None:
        # As a command does before it starts (runs, cli/options.py): all that pytest holds takes long to be looked through.
        gc.collect()
        gc.freeze()
        self.longest_s, self._before_s = 0.0, time.thread_time()
        asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        now_s = time.thread_time()
        self.longest_s, self._before_s = max(self.longest_s, now_s - self._before_s), now_s
        asyncio.get_running_loop().call_later(0.001, self._turn)


def start(
    *arguments: str, env: dict[str, str] | None = None, fresh: bool = False, **files
) -> subprocess.Popen | Forked:
    """`phalanx …`, begun from nothing if `fresh`, or if its environment asks for another beginning (zygote.py)."""
    env = env or {}
    if fresh or not is_plain(env):
        return subprocess.Popen([*PHALANX, *arguments], text=True, cwd=ROOT, env=os.environ | env, **files)
    return Forked(arguments, cwd=ROOT, env=os.environ | env, **files)


class Child:
    """`phalanx …` as a child: its lines of stdout as they come, its stderr, its exit code."""

    def __init__(
        self, *arguments: str, env: dict[str, str] | None = None, stdin: int | None = subprocess.DEVNULL, fresh=False
    ):
        in_real_time()
        env = {"PYTHONUNBUFFERED": "1"} | (env or {})
        self.process = start(
            *arguments, env=env, fresh=fresh, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.out: list[str] = []
        self.err: list[str] = []
        self._threads = [
            threading.Thread(target=self._read, args=pipe, daemon=True)
            for pipe in ((self.process.stdout, self.out), (self.process.stderr, self.err))
        ]
        for thread in self._threads:
            thread.start()

    @staticmethod
    def _read(pipe, lines):
        for line in pipe:
            lines.append(line.rstrip("\n"))

    def events(self, kind: str) -> list[dict]:
        """Those of a kind, without their times."""
        told = [json.loads(line) for line in list(self.out)]
        assert all(abs(event.pop("at_s") - time.time()) < 3600 for event in told)
        return [event for event in told if event["event"] == kind]

    def wait_for(self, kind: str, count: int = 1, timeout_s: float = 60.0) -> dict:
        deadline = time.monotonic() + timeout_s
        while len(found := self.events(kind)) < count:
            assert self.process.poll() is None, f"ended with {self.process.returncode}: {self.err}"
            assert time.monotonic() < deadline, f"no {kind!r} in {self.out[-5:]}, stderr {self.err[-5:]}"
            time.sleep(0.02)
        return found[count - 1]

    def stop(self, number: int = signal.SIGINT, timeout_s: float = 30.0) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait(timeout_s)

    def wait(self, timeout_s: float = 60.0) -> int:
        code = self.process.wait(timeout_s)
        for thread in self._threads:
            thread.join(5)
        return code


def run(
    *arguments: str,
    timeout_s: float = 60,
    env: dict | None = None,
    fresh: bool = False,
    input: str = "",  # noqa: A002
) -> subprocess.CompletedProcess:
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        said.write(input)
        said.seek(0)
        process = start(*arguments, env=env, fresh=fresh, stdin=said, stdout=out, stderr=err)
        try:
            code = process.wait(timeout_s)
        finally:
            process.kill()
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(arguments, code, out.read(), err.read())


def called(*arguments: str) -> subprocess.CompletedProcess:
    """`run`, in this process: a start takes longer than most of what is asked."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run_command([*arguments])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


@pytest.fixture
def phalanx(capsys):
    """Exit code, stdout, stderr of a command."""

    def call(*words: str):
        code = run_command(list(words))
        out, err = capsys.readouterr()
        return code, out, err

    return call


def uncompiled(script: str) -> list[str]:
    """The words that a script prints where nothing is compiled; it stands in the tests' folder."""
    environment = os.environ | {"PHALANX_PURE": "1"}
    where = Path(__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=where, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@contextmanager
def child(*arguments: str, **more):
    running = Child(*arguments, **more)
    try:
        yield running
    finally:
        if running.process.poll() is None:
            running.process.kill()
        running.wait()


@contextmanager
def a_gateway(*arguments: str, qrkey: bool = False, **more):
    """`phalanx up --events` on free ports, serving mode qrkey as well if asked to; yields the child and its 'ready' event.

    Robots do not audit each other unless asked to: most tests are about the link, and any number of them will do.
    """
    defence = () if "--defence" in arguments else ("--defence", "none")
    broker = () if "--broker" in arguments or not qrkey else ("--broker", "mosquitto")
    mode = (*broker, *(("--qrkey",) if qrkey else ()))
    with child("up", "--events", "--port", "0", *defence, *mode, *arguments, **more) as running:
        yield running, running.wait_for("ready")


def secrets_of(ready: dict) -> list[str]:
    """What must never be logged."""
    return [ready["pin"], re.search("token=(.*)", ready["operator_url"]).group(1)]


@pytest.fixture(scope="module")
def browser():
    in_real_time()
    playwright = pytest.importorskip("playwright.sync_api")
    assert CHROMIUM, "apt-get install chromium-headless-shell"
    flags = [*FLAGS, "--no-sandbox"] if os.geteuid() == 0 else FLAGS
    with playwright.sync_playwright() as p:
        running = p.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield running
        running.close()


@pytest.fixture
def pages(tmp_path):
    """A folder with the page that a front end serves."""
    folder = tmp_path / "pages"
    folder.mkdir()
    (folder / "index.html").write_text("<p>drive")
    return folder


@pytest.fixture
def tls(tmp_path):
    """Files of a certificate for localhost and its key."""
    return make_certificate(tmp_path)
