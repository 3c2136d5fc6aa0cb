"""Makes several targets at the same time: `side_by_side.py lint test-web docs`.

What each says comes in one piece when it ends. The last lines tell how each ended; the exit code is 1 if one failed.
Ctrl-C ends all.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO

PATIENCE_S = 20.0


@dataclass
class Part:
    """A target that is being made, in a process group of its own: whatever it starts can be ended with it."""

    target: str
    said: IO[bytes] = field(default_factory=tempfile.TemporaryFile)
    began_s: float = field(default_factory=time.monotonic)
    took_s: float = 0.0

    def __post_init__(self) -> None:
        command = [os.environ.get("MAKE", "make"), "--no-print-directory", self.target]
        # A make under make would take this one's jobs for its own.
        env = {name: value for name, value in os.environ.items() if name not in {"MAKEFLAGS", "MFLAGS", "MAKELEVEL"}}
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self.said, stderr=subprocess.STDOUT, env=env, process_group=0
        )

    def has_ended(self) -> bool:
        if self.process.poll() is None:
            return False
        self.took_s = time.monotonic() - self.began_s
        return True

    def tell(self) -> None:
        self.said.seek(0)
        print(f"\n===== {self} =====", flush=True)
        sys.stdout.buffer.write(self.said.read())
        sys.stdout.flush()

    def end(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, number)

    def __str__(self) -> str:
        return f"{self.target}: {'FAILED' if self.process.returncode else 'passed'}, {self.took_s:.0f} s"


def as_they_end(parts: list[Part]) -> Iterator[Part]:
    running = list(parts)
    while running:
        time.sleep(0.1)
        for part in [part for part in running if part.has_ended()]:
            running.remove(part)
            yield part


def end_all(parts: list[Part]) -> None:
    for part in parts:
        part.end(signal.SIGINT)
    deadline = time.monotonic() + PATIENCE_S
    while any(not part.has_ended() for part in parts) and time.monotonic() < deadline:
        time.sleep(0.1)
    for part in parts:
        part.end(signal.SIGKILL)


def main(targets: list[str]) -> int:
    # Whoever runs in the background of a shell does not hear Ctrl-C, nor does anything that is started from there.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    print(f"side by side: {', '.join(targets)}; each is told of when it ends", flush=True)
    parts = [Part(target) for target in targets]
    try:
        for part in as_they_end(parts):
            part.tell()
    except BaseException as error:
        end_all(parts)
        if isinstance(error, KeyboardInterrupt):
            return 130
        raise
    print("", *parts, sep="\n", flush=True)
    return int(any(part.process.returncode for part in parts))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
