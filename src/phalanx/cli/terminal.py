"""What people see in a terminal: a QR code that scans on any background, and one calm status line."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from typing import Any

import click
import segno

BLACK, WHITE = 16, 231  # of the 256 colours: the first sixteen are the theme's and may be anything


def qr_text(url: str, border: int = 2, *, colour: bool) -> str:
    """The QR code of `url`, two modules a character.

    With colour it is black on white whatever the terminal's theme. Without, light modules are drawn: right on a dark
    background, and read by most phones on a light one too.
    """
    rows = [list(row) for row in segno.make_qr(url, error="l").matrix_iter(border=border)]
    if len(rows) % 2:
        rows.append([0] * len(rows[0]))
    draw = _colour_cell if colour else _plain_cell
    end = "\x1b[0m" if colour else ""
    return "\n".join(
        "".join(draw(bool(top), bool(bottom)) for top, bottom in zip(upper, lower, strict=True)) + end
        for upper, lower in zip(rows[::2], rows[1::2], strict=True)
    )


def _colour_cell(top: bool, bottom: bool) -> str:
    return f"\x1b[38;5;{BLACK if top else WHITE};48;5;{BLACK if bottom else WHITE}m▀"


def _plain_cell(top: bool, bottom: bool) -> str:
    return (" " if bottom else "▄") if top else ("▀" if bottom else "█")


def status_line(text: str) -> None:
    """Put `text` in the place of the last status line; only in a terminal."""
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns
        click.echo(f"\r\x1b[2K{text[: width - 1]}", nl=False, err=True)


def end_status_line() -> None:
    """Leave the status line and go on below it."""
    if sys.stderr.isatty():
        click.echo("", err=True)


def plain(text: object, longest: int = 60) -> str:
    """`text` from a peer, without the characters that would command the terminal instead of showing in it."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in str(text))
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


def print_json(value: Any) -> None:
    """One line of JSON on stdout, at once. If whoever read it has gone, a running gateway is asked to end."""
    try:
        click.echo(json.dumps(value, separators=(",", ":"), allow_nan=False))
    except BrokenPipeError:
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        signal.raise_signal(signal.SIGTERM)
