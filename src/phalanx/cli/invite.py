"""`phalanx link invite` and `phalanx link trail`."""

from __future__ import annotations

import html
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from phalanx.errors import UsageError
from phalanx.net.private_file import write_whole

from .codes import qr_text
from .gateway_of import ask_gateway, default_state
from .terminal import counted, plain, talk

ROLES = {"watcher": "watch", "driver": "drive", "operator": "operate"}
SHEET = """<!doctype html>
<meta charset="utf-8">
<title>Invitations</title>
<style>
body { font: 12pt sans-serif; display: grid; grid-template-columns: repeat(auto-fill, 62mm); gap: 6mm; margin: 8mm; }
section { border: 1px dashed #888; padding: 4mm; text-align: center; break-inside: avoid; }
h2 { margin: 0; font-size: 15pt; }
p { margin: 1mm 0; color: #444; font-size: 9pt; }
svg { width: 50mm; height: 50mm; }
</style>
"""


def invite(
    robots: tuple[str, ...],
    role: str,
    uses: int,
    name: str,
    hours: float,
    sheet: Path | None,
    state: Path | None,
    as_json: bool,
) -> None:
    """Makes tickets: one, or with a sheet one for each robot."""
    words = {"role": ROLES.get(role, role), "uses": uses, "name": name, "valid_s": round(hours * 3600)}
    if sheet is None:
        url = ask_gateway(state, "link/invite", words | {"robots": list(robots)})["url"]
        click.echo(json.dumps({"url": url}) if as_json else url)
        if sys.stdout.isatty() and not as_json:
            click.echo(qr_text(url, colour=True))
        return
    if words["role"] != "drive" and not robots:
        raise UsageError("a sheet has a card for each robot", "--role driver, or without --sheet")
    known = ask_gateway(state, "link/state", {})["robots"]
    listed = {robot["name"] or robot["address"]: robot["address"] for robot in known}
    cards = []
    for robot in robots or sorted(listed):
        card = words | {"robots": [listed.get(robot, robot)], "name": name or robot}
        cards.append((robot, ask_gateway(state, "link/invite", card)["svg"]))
    write_whole(sheet, sheet_of(cards, uses).encode(), "a folder that is yours", private=True)
    talk(f"{counted(len(cards), 'card')} in {plain(sheet)}: whoever has one drives; print it, and delete it")


def sheet_of(cards: Sequence[tuple[str, str]], uses: int) -> str:
    """Return a page with a card for each robot: its name and QR code."""
    times = "for one visitor" if uses == 1 else f"for {uses} visitors"
    made = (f"<section><h2>{html.escape(robot)}</h2>{svg}<p>{times}</p></section>\n" for robot, svg in cards)
    return SHEET + "".join(made)


def export(file: Path | None, state: Path | None) -> None:
    """Prints the trail, checked, as it stands in its file."""
    from phalanx.gateway.chain_file import as_line, read_lines  # noqa: PLC0415 - as above

    for words in read_lines(_trail(file, state)):
        click.echo(as_line(words))


def verify(file: Path | None, state: Path | None, top: str | None) -> None:
    """Checks the trail, and whether a line that was noted before, or by the gateway, is still in it."""
    from phalanx.gateway.chain_file import mark_of, read_lines, read_mark  # noqa: PLC0415 - as above

    path = _trail(file, state)
    mark = read_mark(path)  # first: a gateway may add lines meanwhile
    wanted = {each for each in (top, mark and mark[1]) if each}
    count, last, gaps = 0, "", list[int]()
    for words in read_lines(path):
        count, last = count + 1, words["chain"]
        wanted.discard(last)
        if words.get("event") in ("cut_off", "moved_aside"):
            gaps.append(count)
    if top in wanted:
        raise UsageError("the trail does not contain that hash", "its end was cut off, or it is another trail")
    if wanted:
        hint = f"{plain(mark_of(path))} has the hash of the last line that the gateway wrote; restore the rest"
        raise UsageError(f"the end of {plain(path)} was cut off", hint)
    if gaps:
        hint = "the gateway saw it when it started; restore them, or go by what was noted elsewhere"
        raise UsageError(f"lines are missing before line {gaps[0]} of {plain(path)}", hint)
    click.echo(f"{counted(count, 'line')}, whole; the last is {last or 'none'}")
    if not mark and not top:
        talk(f"not checked: whether its end was cut off, as there is no {plain(mark_of(path))}; --top HASH checks it")


def _trail(file: Path | None, state: Path | None) -> Path:
    from phalanx.gateway.state_folder import TRAIL  # noqa: PLC0415 - as above

    return file or (state or default_state()) / TRAIL
