"""Draw QR codes in a terminal."""

from __future__ import annotations

import re
from typing import Any

import segno

MANY_DIGITS = re.compile(r"([0-9]{12,})")
BLACK, WHITE = 16, 231  # of the 256 colours: a terminal's theme can redefine the first sixteen


def qr_text(url: str, border: int = 2, *, colour: bool) -> str:
    """Return the QR code of `url`, two modules per character: with colour, black on white in every theme.

    Without colour the light modules are drawn. That is correct on a dark background, and most phones also read it on a
    light one.
    """
    # As a separate numeric segment the pin takes 130 bits, not 312: the code is one size smaller and fits 24 lines.
    parts: Any = [part for part in MANY_DIGITS.split(url) if part]  # segno's types know only one part
    rows = [list(row) for row in segno.make_qr(parts, error="l").matrix_iter(border=border)]
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
