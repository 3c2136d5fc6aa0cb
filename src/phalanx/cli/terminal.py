"""Print to a terminal a status line, rows and JSON, and read its emergency stop."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import queue
import shutil
import signal
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import click

from phalanx.papers.figure import MATPLOTLIB_HINT

EVERY_S = 5.0  # between two lines of progress where there is no terminal
MOST_LINES = 10_000
STOP, GO = ("", "stop"), "go"
IN_THE_BACKGROUND_S = 1.0
LONGEST = 4096


def status_line(text: str, *more: str) -> None:
    """Put `text` in the place of the last status line; only in a terminal. Of `more`, what comes first fits first."""
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns - 1
        for part in more:
            if len(text) + 2 + len(part) > width:
                break
            text += f"  {part}"
        click.echo(f"\r\x1b[2K{text[:width]}", nl=False, err=True)


@contextlib.contextmanager
def said_aside() -> Iterator[None]:
    """Send to stderr what files of a researcher's print while they run: stdout is data."""
    with contextlib.redirect_stdout(sys.stderr):
        yield


def end_status_line() -> None:
    """Leave the status line and go on below it."""
    if sys.stderr.isatty():
        click.echo("", err=True)


class Progress:
    """What is done so far, on stderr: one line that changes in a terminal; elsewhere a line now and then."""

    def __init__(self) -> None:
        self._due_s = time.monotonic() + EVERY_S
        self._over = False

    def tell(self, text: str, share: float) -> None:
        """`share` of the work is done, 0 to 1."""
        status_line(f"{text}   {100 * share:.0f} %   Ctrl-C stops")
        over, now_s = share >= 1, time.monotonic()
        if not sys.stderr.isatty() and (now_s >= self._due_s or (over and not self._over)):
            self._due_s = now_s + EVERY_S
            click.echo(text, err=True)
        self._over = over


def beside(head: str, text: str) -> str:
    """`text` to the right of `head`, in lines as wide as the terminal; one line where stdout is none."""
    if not sys.stdout.isatty():
        return head + text
    width = shutil.get_terminal_size().columns
    return textwrap.fill(text, width, initial_indent=head, subsequent_indent=" " * len(head))


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Rows under their heads, on stdout, each column as wide as its widest cell."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for line in (heads, *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def counted(count: int, what: str) -> str:
    """`1 robot`, `2 robots`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def print_rows(rows: Mapping[str, str]) -> None:
    """What is told under each label, on stdout."""
    for label, words in rows.items():
        click.echo(f"{label:22} {words}")


def talk(words: str) -> None:
    """One line on stderr, in the place of the status line if there is one."""
    status_line("")
    click.echo(f"phalanx: {words}", err=True)


def warn_if_nothing_is_drawn() -> None:
    """One line on stderr before minutes are spent on a figure that cannot be drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        click.echo(f"phalanx: warning: matplotlib is not installed, nothing will be drawn; {MATPLOTLIB_HINT}", err=True)


def stopped(kept: str = "") -> int:
    """Tell on stderr that Ctrl-C stopped the command, and what is kept of it. Returns: the exit code."""
    end_status_line()
    click.echo("; ".join(filter(None, ("stopped", kept))), err=True)
    return 1


def plain(text: object, longest: int = 60) -> str:
    """`text` from a peer, without the characters that would command the terminal instead of showing in it."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in str(text))
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


class EventLines:
    """Prints JSON lines from a thread: behind a reader that stalls it drops lines past MOST_LINES or `limit_bytes`."""

    def __init__(self, limit_bytes: int = 16 * 1024 * 1024) -> None:
        self.lost = 0
        self._failure: OSError | None = None
        self._waiting: queue.Queue[str | None] = queue.Queue(MOST_LINES)
        self._limit_bytes = limit_bytes
        self._put_bytes = self._got_bytes = 0  # each changed by one thread only
        self._thread = threading.Thread(target=self._print, daemon=True)
        self._thread.start()

    def __call__(self, event: dict[str, Any]) -> None:
        """Print `event` soon, with the time of now."""
        line = json_line(timed(event))
        if self._put_bytes - self._got_bytes + len(line) > self._limit_bytes:
            self.lost += 1
            return
        try:
            self._waiting.put_nowait(line)
            self._put_bytes += len(line)
        except queue.Full:
            self.lost += 1

    def close(self, timeout_s: float = 0.5) -> None:
        """Print what waits, if somebody reads. Raises: OSError: nothing more can be written: the disk is full."""
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)
        self._thread.join(timeout_s)
        if self._failure is not None:
            raise self._failure

    def _print(self) -> None:
        try:
            while (line := self._waiting.get()) is not None:
                if self.lost:
                    lost, self.lost = self.lost, 0
                    print_json(timed({"event": "lost", "count": lost}))
                write_line(line)
                self._got_bytes += len(line)
        except OSError as error:
            self._failure = error
            os.kill(os.getpid(), signal.SIGTERM)


def timed(event: dict[str, Any]) -> dict[str, Any]:
    """`event`, and when it is told: seconds since 1970, to the millisecond."""
    return {**event, "at_s": round(time.time(), 3)}


def json_line(value: Any) -> str:
    """`value` as one line of JSON: ASCII, so that a character is a byte."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def print_json(value: Any) -> None:
    """One line of JSON on stdout, at once. If whoever read it has gone, a running gateway is asked to end."""
    write_line(json_line(value))


def write_line(line: str) -> None:
    """`line` on stdout, at once. If whoever read it has gone, a running gateway is asked to end."""
    try:
        click.echo(line)
    except BrokenPipeError:
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        os.kill(os.getpid(), signal.SIGTERM)


def heed_stop_words(hold: Callable[[bool], None], others: Mapping[str, Callable[[], object]] | None = None) -> None:
    """Enter or `stop` on stdin holds all robots, `go` lets them go again, until stdin ends; so for other words."""
    # A shell's background job may not read: it is told so by an error instead of being stopped itself.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    threading.Thread(target=_listen, args=(hold, others or {}), name="stop word", daemon=True).start()


def _listen(hold: Callable[[bool], None], others: Mapping[str, Callable[[], object]]) -> None:
    waiting = b""
    while True:
        try:
            # By hand: a thread that sits in a buffer's lock does not let the interpreter end.
            said = os.read(sys.stdin.fileno(), LONGEST)
        except OSError:
            time.sleep(IN_THE_BACKGROUND_S)
            continue
        if not said:
            return
        *lines, waiting = (waiting + said).split(b"\n")
        waiting = waiting[:LONGEST]
        for line in lines:
            word = line.decode(errors="replace").strip().lower()
            if act := others.get(word):
                act()
            else:
                _obey(word, hold)


def _obey(word: str, hold: Callable[[bool], None]) -> None:
    if word in STOP:
        hold(True)
        talk("all robots stand still; type go and Enter to let them go")
    elif word == GO:
        hold(False)
        talk("robots may move again")
    else:
        talk("Enter, or stop and Enter, stops all robots; go and Enter lets them go again")
