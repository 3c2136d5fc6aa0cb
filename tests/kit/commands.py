"""The command line, called in this process or run as a child, and a gateway as a child."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

from phalanx.cli.main import run_command
from waiting import in_real_time
from zygote import Forked, is_plain

ROOT = Path(__file__).parents[2]
PHALANX = [sys.executable, "-m", "phalanx"]


def start(
    *arguments: str, env: dict[str, str] | None = None, fresh: bool = False, cwd: Path = ROOT, **files
) -> subprocess.Popen | Forked:
    """`phalanx …`, begun from nothing if `fresh`, or if its environment asks for another beginning (zygote.py)."""
    env = env or {}
    if fresh or not is_plain(env):
        return subprocess.Popen([*PHALANX, *arguments], text=True, cwd=cwd, env=os.environ | env, **files)
    return Forked(arguments, cwd=cwd, env=os.environ | env, **files)


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
    cwd: Path = ROOT,
    input: str = "",  # noqa: A002
) -> subprocess.CompletedProcess:
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        said.write(input)
        said.seek(0)
        process = start(*arguments, env=env, fresh=fresh, cwd=cwd, stdin=said, stdout=out, stderr=err)
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


def uncompiled(script: str) -> list[str]:
    """The words that a script prints where nothing is compiled; it stands in the tests' folder."""
    kit = Path(__file__).parent
    path = os.pathsep.join(filter(None, [str(kit), os.environ.get("PYTHONPATH")]))
    environment = os.environ | {"PHALANX_PURE": "1", "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=kit.parent, capture_output=True, text=True, check=True
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
