"""Print a status line, rows and JSON to a terminal, and read the emergency stop from it."""

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

EVERY_S = 5.0  # between two lines of progress without a terminal
MOST_LINES = 10_000
STOP, GO = ("", "stop"), "go"
IN_THE_BACKGROUND_S = 1.0
LONGEST = 4096


def status_line(text: str, *more: str) -> None:
    """Replace the status line by `text`, on terminals only. Parts of `more` are appended in order while they fit."""
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns - 1
        for part in more:
            if len(text) + 2 + len(part) > width:
                break
            text += f"  {part}"
        click.echo(f"\r\x1b[2K{text[:width]}", nl=False, err=True)


@contextlib.contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Send what users' own files print to stderr while they run, as stdout is data."""
    with contextlib.redirect_stdout(sys.stderr):
        yield


def end_status_line() -> None:
    """Keep the status line and continue below it."""
    if sys.stderr.isatty():
        click.echo("", err=True)


class Progress:
    """Progress on stderr: one changing line on a terminal, elsewhere a line every EVERY_S."""

    def __init__(self) -> None:
        self._due_s = time.monotonic() + EVERY_S
        self._over = False

    def tell(self, text: str, share: float) -> None:
        """Show that `share` of the work is done, 0 to 1."""
        status_line(f"{text}   {100 * share:.0f} %   Ctrl-C stops")
        over, now_s = share >= 1, time.monotonic()
        if not sys.stderr.isatty() and (now_s >= self._due_s or (over and not self._over)):
            self._due_s = now_s + EVERY_S
            click.echo(text, err=True)
        self._over = over


def beside(head: str, text: str) -> str:
    """Return `text` to the right of `head`, wrapped to the terminal's width; in one line if stdout is no terminal."""
    if not sys.stdout.isatty():
        return head + text
    width = shutil.get_terminal_size().columns
    return textwrap.fill(text, width, initial_indent=head, subsequent_indent=" " * len(head))


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headings on stdout, each column as wide as its widest cell."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for line in (heads, *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def count_of(count: int, what: str) -> str:
    """Return `1 robot`, `2 robots`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def print_rows(rows: Mapping[str, str]) -> None:
    """Print each label with its text, on stdout."""
    for label, words in rows.items():
        click.echo(f"{label:22} {words}")


def talk(words: str) -> None:
    """Print one line on stderr, in place of the status line."""
    status_line("")
    click.echo(f"phalanx: {words}", err=True)


def warn_if_nothing_is_drawn() -> None:
    """Warn on stderr, before the measurement, that figures cannot be drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        click.echo(f"phalanx: warning: matplotlib is not installed, nothing will be drawn; {MATPLOTLIB_HINT}", err=True)


def stopped(kept: str = "") -> int:
    """Print that Ctrl-C stopped the command, and what is kept. Return the exit code."""
    end_status_line()
    click.echo("; ".join(filter(None, ("stopped", kept))), err=True)
    return 1


def plain(text: object, longest: int = 60) -> str:
    """Return a peer's `text` without control characters, which would command the terminal, and shortened."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in str(text))
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


class EventLines:
    """Printer of JSON lines in a thread. If the reader stalls, it drops lines beyond MOST_LINES or `limit_bytes`."""

    def __init__(self, limit_bytes: int = 16 * 1024 * 1024) -> None:
        self.lost = 0
        self._failure: OSError | None = None
        self._waiting: queue.Queue[str | None] = queue.Queue(MOST_LINES)
        self._limit_bytes = limit_bytes
        self._put_bytes = self._got_bytes = 0  # each changed by one thread only
        self._thread = threading.Thread(target=self._print, daemon=True)
        self._thread.start()

    def __call__(self, event: dict[str, Any]) -> None:
        """Enqueue `event` with the current time."""
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
        """Print the queued lines if the reader keeps up. Raises: OSError: the disk is full."""
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
    """Return `event` with the current time, seconds since 1970, to the millisecond."""
    return {**event, "at_s": round(time.time(), 3)}


def json_line(value: Any) -> str:
    """Return `value` as one line of JSON in ASCII, so that a character is a byte."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def print_json(value: Any) -> None:
    """Print one line of JSON on stdout, flushed. If the reader has exited, end a running gateway."""
    write_line(json_line(value))


def write_line(line: str) -> None:
    """Print `line` on stdout, flushed. If the reader has exited, end a running gateway."""
    try:
        click.echo(line)
    except BrokenPipeError:
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        os.kill(os.getpid(), signal.SIGTERM)


def read_stop_commands(hold: Callable[[bool], None], others: Mapping[str, Callable[[], object]] | None = None) -> None:
    """Read commands from stdin: Enter or `stop` holds all robots, `go` releases them, and `others` by word."""
    # A background job that reads gets an error instead of being stopped by SIGTTIN.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    threading.Thread(target=_listen, args=(hold, others or {}), name="stop word", daemon=True).start()


def _listen(hold: Callable[[bool], None], others: Mapping[str, Callable[[], object]]) -> None:
    waiting = b""
    while True:
        try:
            # Unbuffered: a thread that holds a buffer's lock would keep the interpreter from exiting.
            data = os.read(sys.stdin.fileno(), LONGEST)
        except OSError:
            time.sleep(IN_THE_BACKGROUND_S)
            continue
        if not data:
            return
        *lines, waiting = (waiting + data).split(b"\n")
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
        talk("all robots are stopped; type go and Enter to release them")
    elif word == GO:
        hold(False)
        talk("robots may move again")
    else:
        talk("Enter, or stop and Enter, stops all robots; go and Enter releases them")
