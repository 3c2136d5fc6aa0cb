"""`phalanx mission crack`: run a brute-force attack on a captured mission."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import click

from phalanx.cli.terminal import end_status_line, print_json, status_line
from phalanx.errors import UsageError
from phalanx.lab.cracking.force import GuessedNode, TriedBatch, can_guess, crack_paper, crack_sealed
from phalanx.mission import EncodedMission, Profile, parse_start_key
from phalanx.mission.file.records import OPEN_START
from phalanx.mission.worth.shown import PlanCandidates, candidates_in
from phalanx.world.building.floorplan import load_floorplan

from .files import parse_box, read_encoded, read_start_key


def span(seconds: float) -> str:
    """Return a duration as text, in a convenient unit."""
    for size, unit in ((31_557_600, "years"), (86_400, "days"), (3600, "h"), (60, "min"), (1, "s"), (1e-3, "ms")):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e6:.3g} µs"


def crack(
    file: Path, key: Path | None, box: str, plan: str | None, offset_mm: int, budget: float, as_json: bool
) -> int:
    """Try to read a captured mission by brute force for `budget` seconds. Return 1 if nothing was found."""
    encoded, area = read_encoded(file), parse_box(box)
    if plan and encoded.header.profile is Profile.PAPER:
        raise UsageError("--map with the paper profile", "leave it out: all places are tried in seconds")
    map_places = candidates_in(load_floorplan(plan), offset_mm) if plan else None
    started = time.perf_counter()
    tries, of = 0, 0
    found: list[tuple[GuessedNode, float]] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for batch in _attack(encoded, key, area, pool, map_places):
            tries, of = tries + batch.tries, batch.of
            spent = time.perf_counter() - started
            found += [(node, spent) for node in batch.found]
            status_line(
                f"{tries:.3g} of {of:.3g} tries   {_read(found)} of {encoded.header.nodes} nodes   Ctrl-C stops"
            )
            if spent >= budget or _read(found) >= encoded.header.nodes:
                break
    end_status_line()
    spent = time.perf_counter() - started
    _show_cracked(encoded, found, tries, of, spent, as_json)
    return 0 if found else 1


def _attack(
    encoded: EncodedMission,
    key: Path | None,
    area: tuple[float, float, float, float],
    pool: ThreadPoolExecutor,
    map_places: PlanCandidates | None,
) -> Iterator[TriedBatch]:
    if encoded.header.profile is Profile.PAPER:
        return crack_paper(encoded, area)
    if key is not None:
        start = read_start_key(key)
        if start.mission_id != encoded.header.mission_id:
            raise UsageError("the start key belongs to another mission", "use the key that build wrote with it")
    elif encoded.header.flags & OPEN_START:
        start = parse_start_key(encoded.start)
    else:
        raise UsageError(
            "a sealed mission cannot be read without its start key: it is one of 2^256",
            "use --key FILE, if it was captured too",
        )
    return crack_sealed(encoded, start, area, pool.map, map_places)


def _show_cracked(
    encoded: EncodedMission, found: list[tuple[GuessedNode, float]], tries: int, of: int, spent_s: float, as_json: bool
) -> None:
    rate = tries / spent_s if spent_s else 0.0
    paper, coding = encoded.header.profile is Profile.PAPER, encoded.header.coding
    skipped = sum(not can_guess(shape) for shape in encoded.header.shapes)
    # A sealed node hides the number of gates behind it, so this extrapolates from the nodes read so far.
    whole_s = of / rate if rate else 0.0
    if as_json:
        print_json(
            {
                "profile": encoded.header.profile.name.lower(),
                "nodes": encoded.header.nodes,
                "found": [{**asdict(node), "at_s": at_s} for node, at_s in found],
                "tries": tries,
                "candidates": of,
                "seconds": spent_s,
                "tries_per_s": rate,
                "extrapolated_s": whole_s,
                "kdf": None if paper else {"log2_n": coding.kdf_log2_n, "r": coding.kdf_r},
                "shapes_not_tried": skipped,
            }
        )
        return
    for node, at_s in found:
        turn = "" if node.orientation_rad is None else f"   {node.orientation_rad:+.2f} rad"
        click.echo(f"node {node.node:<6}{node.kind:16}{node.x_m:8.2f}{node.y_m:8.2f} m   after {span(at_s)}{turn}")
    click.echo(
        f"{_read(found)} of {encoded.header.nodes} nodes read, {tries:.3g} tries in {span(spent_s)}, {rate:.3g}/s"
    )
    what = "all places in this area" if paper else "all gates read so far"
    click.echo(f"{what}: {of:.3g} tries, {span(whole_s)} at this rate")
    if skipped:
        click.echo(f"{skipped} kinds of conjunctions depend on more than a place, and were not tried")


def _read(found: list[tuple[GuessedNode, float]]) -> int:
    """Return the number of nodes read; one node can be found by several aliases."""
    return len({node.node for node, _ in found})
