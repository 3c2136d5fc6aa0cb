"""`phalanx …` as a process of its own that begins where a start ends: forked from one that has imported its modules.

A start of `phalanx up` takes 1.2 s of a processor, more than most tests of a running command need besides. What is forked
is a process as any other: its own words, files, signals and end. It runs `phalanx/__main__.py` as `python -m phalanx` does,
and shares no state with what was forked before. What a start itself does is tested by starts (`fresh=True`).
"""

from __future__ import annotations

import contextlib
import gc
import io
import os
import pickle
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import time

# Read by Python itself, by our kernels and by coverage as they are imported.
OF_A_START = ("PYTHON", "PHALANX_PURE", "OPENBLAS_", "COVERAGE_", "LC_", "LANG")
_ENDED = struct.Struct("<i")
_running: list[tuple[socket.socket, subprocess.Popen]] = []


def is_plain(env: dict[str, str]) -> bool:
    """Whether a process with these variables beside ours starts as the forked ones do."""
    changed = {name for name in env if env[name] != os.environ.get(name)} - {"PYTHONUNBUFFERED"}
    measured = any(name.startswith("COVERAGE_") for name in os.environ)
    return not measured and not any(name.startswith(OF_A_START) for name in changed)


def _zygote() -> socket.socket:
    if not _running:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            words = [sys.executable, __file__, str(theirs.fileno())]
            _running.append((ours, subprocess.Popen(words, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)))
    return _running[0][0]


class Forked:
    """What tests use of `subprocess.Popen`, of a forked process."""

    def __init__(self, words, *, env, cwd, stdin, stdout, stderr, text=True):
        self.args, self.returncode, self._told, ours, theirs = words, None, b"", [], []
        for number, where in enumerate((stdin, stdout, stderr)):
            ours.append(None)
            if where == subprocess.PIPE:
                read, write = os.pipe()
                theirs.append(read if number == 0 else write)
                ends = (write, "w") if number == 0 else (read, "r")
                ours[number] = os.fdopen(ends[0], ends[1] if text else ends[1] + "b")
            elif where == subprocess.DEVNULL:
                theirs.append(os.open(os.devnull, os.O_RDWR))
            else:
                theirs.append(os.dup(number if where is None else where if isinstance(where, int) else where.fileno()))
        self.stdin, self.stdout, self.stderr = ours
        self._ends, told = os.pipe()
        theirs.append(told)
        socket.send_fds(_zygote(), [pickle.dumps((words, env, str(cwd)))], theirs)
        for each in theirs:
            os.close(each)
        (self.pid,) = _ENDED.unpack(os.read(self._ends, _ENDED.size))

    def poll(self):
        if self.returncode is None and select.select([self._ends], [], [], 0)[0]:
            (self.returncode,) = _ENDED.unpack(os.read(self._ends, _ENDED.size))
            os.close(self._ends)
        return self.returncode

    def wait(self, timeout=None):
        if self.returncode is None and not select.select([self._ends], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(self.args, timeout)
        return self.poll()

    def send_signal(self, number):
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def _begin(words, env, cwd, files) -> None:
    """As Python begins: in its folder, with its variables and files, and its own answer to Ctrl-C."""
    for number, file in enumerate(files):
        os.dup2(file, number)
        os.close(file)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    time.tzset()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    at_once = bool(env.get("PYTHONUNBUFFERED"))
    sys.stdin = sys.__stdin__ = open(0, encoding="utf-8")
    for number, name in ((1, "stdout"), (2, "stderr")):
        raw = open(number, "wb", 0 if at_once else -1)  # noqa: PTH123
        how = "backslashreplace" if number == 2 else "strict"
        text = io.TextIOWrapper(raw, "utf-8", how, line_buffering=number == 2 or raw.isatty(), write_through=at_once)
        setattr(sys, name, text)
        setattr(sys, f"__{name}__", text)
    sys.path[0], sys.argv[1:] = cwd, words


def _keep(words, env, cwd, files, told) -> bool:
    """Start a process and tell its number and, when it has ended, how. True in that process, which goes on."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    if (pid := os.fork()) == 0:
        os.close(told)
        _begin(words, env, cwd, files)
        return True
    for file in files:
        os.close(file)
    os.write(told, _ENDED.pack(pid))
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(BrokenPipeError):  # a test that did not wait
        os.write(told, _ENDED.pack(os.waitstatus_to_exitcode(status)))
    os._exit(0)


def _serve(asked: socket.socket) -> bool:
    """Fork whatever is asked for until nobody can ask any more. True in a process that was asked for."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever stops the tests stops us by going
    gc.collect()
    gc.freeze()
    while True:
        said, given, *_ = socket.recv_fds(asked, 1 << 18, 4)
        if not said:
            return False
        if os.fork() == 0:
            asked.close()
            *files, told = given
            return _keep(*pickle.loads(said), files, told)
        for file in given:
            os.close(file)


if __name__ == "__main__":
    import phalanx.cli.link
    import phalanx.cli.robot
    import phalanx.cli.up
    import phalanx.gateway.demo  # noqa: F401

    if _serve(socket.socket(fileno=int(sys.argv.pop(1)))):
        runpy.run_module("phalanx", run_name="__main__", alter_sys=True)
