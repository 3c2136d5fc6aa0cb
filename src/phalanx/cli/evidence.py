"""Record a robot's log, and replay it, for `phalanx robot log` and `verify`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import click

from phalanx.daemon.evidence import read_kept, record_log
from phalanx.daemon.proofs import Proven, mission_key_of, proven, signed_in
from phalanx.daemon.settings import read_robot
from phalanx.errors import UsageError
from phalanx.scenarios.own import find_controller, mistakes_in

from .credentials import passphrase_of, read_trusted
from .terminal import print_json, talk


def log(robot: Path, out: Path) -> int:
    """Record all that a robot logged in its mission."""
    count = record_log(read_robot(robot).log_file, out)
    talk(f"{out}: {count} entries")
    return 0


def verify(
    file: Path,
    controller: str | None,
    keys: Path | None,
    issued: Path | None,
    passphrase_file: Path | None,
    trust: tuple[str, ...],
    as_json: bool,
) -> int:
    """Replay a log and print where it is not an honest robot's; with keys, also what its trusted nodes bear out."""
    if (keys is None) != (issued is None):
        raise UsageError("--keys and --key belong together", "give both, or neither")
    trusted = [read_trusted(each).hex() for each in trust]
    kept = read_kept(file)
    signer = kept.mission_signer
    of_mission, is_as_signed = _mission_of(signer, kept.signed is not None, trusted)
    scenario, own = find_controller(controller, kept.scenario, in_python=True)
    kept = replace(kept, scenario=scenario)
    borne: Proven | None = None
    if keys and issued:
        borne = proven(kept, mission_key_of(kept, keys, passphrase_of(keys, passphrase_file), issued))
    with mistakes_in(controller):
        found, entries = kept.first_lie(own), len(kept.entries())
    signed = signed_in(kept)
    at_s = None if found is None else (found.t_ms - kept.t_key_ms) / 1000
    reason = "" if found is None else found.refusal.name.lower().replace("_", " ")
    if as_json:
        print_json(
            {
                "robot": kept.robot,
                "mission": kept.mission,
                "entries": entries,
                "honest": found is None,
                "entry": None if found is None else found.entry,
                "at_s": at_s,
                "reason": reason or None,
                "mission_signer": signer or None,
                "proven_entries": None if borne is None else borne.entries,
                "disproved_at": None if borne is None else borne.false_at,
                "signed": [asdict(each) for each in signed],
            }
        )
    else:
        words = "honest" if found is None else f"FAULT at entry {found.entry}, {at_s:.3f} s: {reason}"
        click.echo(f"robot {kept.robot}   mission {kept.mission}   {entries} entries   {words}{_borne(borne)}")
        click.echo(of_mission)
        for each in signed:
            key = f" ({each.key})" if each.key else ""
            click.echo(f"told {each.count} times from {each.first_s:.1f} to {each.last_s:.1f} s by {each.signer}{key}")
    return int(found is not None or (borne is not None and not borne.holds) or not is_as_signed)


def _mission_of(by: str, is_signed: bool, trusted: list[str]) -> tuple[str, bool]:
    """Whose word it is that the log's mission is the robot's, and whether that is as it should be."""
    if is_signed and not by:
        return "its mission is NOT THE ONE THAT WAS SIGNED", False
    if trusted and by not in trusted:
        return (f"its mission was signed by {by}, WHO IS NOT TRUSTED" if by else "NOBODY SIGNED ITS MISSION"), False
    return (f"its mission was signed by {by}" if by else "its mission is its own word: nobody signed it"), True


def _borne(borne: Proven | None) -> str:
    if borne is None:
        return ""
    if borne.false_at is not None:
        return f"   NOT WHAT ITS TRUSTED NODES SAW by entry {borne.false_at}; proven: the first {borne.entries}"
    return f"   proven by its trusted nodes: the first {borne.entries}" if borne.holds else "   NOTHING IS PROVEN"
