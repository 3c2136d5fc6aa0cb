"""`phalanx link invite` and `phalanx link trail`: create tickets, and export or check the audit trail."""

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
from .terminal import count_of, plain, talk

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
    """Create one ticket, or with `sheet` one for each robot."""
    line = {"role": ROLES.get(role, role), "uses": uses, "name": name, "valid_s": round(hours * 3600)}
    if sheet is None:
        url = ask_gateway(state, "link/invite", line | {"robots": list(robots)})["url"]
        click.echo(json.dumps({"url": url}) if as_json else url)
        if sys.stdout.isatty() and not as_json:
            click.echo(qr_text(url, colour=True))
        return
    if line["role"] != "drive" and not robots:
        raise UsageError("a sheet has a card for each robot", "use --role driver, or leave out --sheet")
    known = ask_gateway(state, "link/state", {})["robots"]
    listed = {robot["name"] or robot["address"]: robot["address"] for robot in known}
    cards = []
    for robot in robots or sorted(listed):
        card = line | {"robots": [listed.get(robot, robot)], "name": name or robot}
        cards.append((robot, ask_gateway(state, "link/invite", card)["svg"]))
    write_whole(sheet, sheet_of(cards, uses).encode(), "use a folder that you can write to", private=True)
    talk(
        f"{count_of(len(cards), 'card')} in {plain(sheet)}: each lets its holder drive; print the file, then delete it"
    )


def sheet_of(cards: Sequence[tuple[str, str]], uses: int) -> str:
    """Return an HTML page with a card for each robot: its name and QR code."""
    times = "for one visitor" if uses == 1 else f"for {uses} visitors"
    made = (f"<section><h2>{html.escape(robot)}</h2>{svg}<p>{times}</p></section>\n" for robot, svg in cards)
    return SHEET + "".join(made)


def export(file: Path | None, state: Path | None) -> None:
    """Print the lines of the trail's file after checking them."""
    from phalanx.gateway.chain_file import as_line, read_lines  # noqa: PLC0415 - slow to import

    for line in read_lines(_trail(file, state)):
        click.echo(as_line(line))


def verify(file: Path | None, state: Path | None, top: str | None) -> None:
    """Check the trail, and that it still contains the line noted earlier by the operator or the gateway."""
    from phalanx.gateway.chain_file import mark_of, read_lines, read_mark  # noqa: PLC0415 - slow to import

    path = _trail(file, state)
    mark = read_mark(path)  # first, as the gateway may add lines meanwhile
    wanted = {each for each in (top, mark and mark[1]) if each}
    count, last, gaps = 0, "", list[int]()
    for line in read_lines(path):
        count, last = count + 1, line["chain"]
        wanted.discard(last)
        if line.get("event") in ("cut_off", "moved_aside"):
            gaps.append(count)
    if top in wanted:
        raise UsageError("the trail does not contain that hash", "its end was cut off, or this is another trail")
    if wanted:
        hint = f"{plain(mark_of(path))} has the hash of the last line that the gateway wrote; restore the missing lines"
        raise UsageError(f"the end of {plain(path)} was cut off", hint)
    if gaps:
        hint = "the gateway noticed this at its start; restore the lines, or use another copy of the trail"
        raise UsageError(f"lines are missing before line {gaps[0]} of {plain(path)}", hint)
    click.echo(f"{count_of(count, 'line')}, complete; last hash: {last or 'none'}")
    if not mark and not top:
        talk(f"not checked whether the end was cut off: no {plain(mark_of(path))}; use --top HASH")


def _trail(file: Path | None, state: Path | None) -> Path:
    from phalanx.gateway.state_folder import TRAIL  # noqa: PLC0415 - slow to import

    return file or (state or default_state()) / TRAIL
