"""Record and replay a robot's log, for `phalanx robot log` and `verify`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import click

from phalanx.daemon.evidence import read_robot_log, record_log
from phalanx.daemon.proofs import ProofResult, check_proofs, count_signed_messages, mission_key_of
from phalanx.daemon.settings import read_robot
from phalanx.errors import UsageError
from phalanx.scenarios.own import find_controller, mistakes_in

from .credentials import passphrase_of, read_trusted
from .terminal import print_json, talk


def log(robot: Path, out: Path) -> int:
    """Record all entries that a robot logged in its mission."""
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
    """Replay a log and print where the robot deviated; with keys, check it against the trusted nodes' MACs."""
    if (keys is None) != (issued is None):
        raise UsageError("--keys and --key need each other", "give both, or neither")
    trusted = [read_trusted(each).hex() for each in trust]
    kept = read_robot_log(file)
    signer = kept.mission_signer
    mission_line, is_as_signed = _mission_signer(signer, kept.signed is not None, trusted)
    scenario, own = find_controller(controller, kept.scenario, in_python=True)
    kept = replace(kept, scenario=scenario)
    proof: ProofResult | None = None
    if keys and issued:
        proof = check_proofs(kept, mission_key_of(kept, keys, passphrase_of(keys, passphrase_file), issued))
    with mistakes_in(controller):
        found, entries = kept.first_dishonest_entry(own), len(kept.entries())
    signed = count_signed_messages(kept)
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
                "proven_entries": None if proof is None else proof.entries,
                "disproved_at": None if proof is None else proof.false_at,
                "signed": [asdict(each) for each in signed],
            }
        )
    else:
        verdict = "honest" if found is None else f"FAULT at entry {found.entry}, {at_s:.3f} s: {reason}"
        click.echo(f"robot {kept.robot}   mission {kept.mission}   {entries} entries   {verdict}{_proof_text(proof)}")
        click.echo(mission_line)
        for each in signed:
            key = f" ({each.key})" if each.key else ""
            span = f"from {each.first_s:.1f} to {each.last_s:.1f} s"
            click.echo(f"{each.count} messages {span}, signed by {each.signer}{key}")
    return int(found is not None or (proof is not None and not proof.holds) or not is_as_signed)


def _mission_signer(by: str, is_signed: bool, trusted: list[str]) -> tuple[str, bool]:
    """Return a line that names the mission's signer, and whether the signature is acceptable."""
    if is_signed and not by:
        return "its mission is NOT THE SIGNED ONE", False
    if trusted and by not in trusted:
        return (f"its mission was signed by {by}, WHICH IS NOT TRUSTED" if by else "ITS MISSION IS NOT SIGNED"), False
    return (f"its mission was signed by {by}" if by else "its mission is not signed: it is the robot's claim"), True


def _proof_text(proof: ProofResult | None) -> str:
    if proof is None:
        return ""
    if proof.false_at is not None:
        return f"   NOT WHAT ITS TRUSTED NODES RECORDED, by entry {proof.false_at}; proven: the first {proof.entries}"
    return f"   proven by its trusted nodes: the first {proof.entries}" if proof.holds else "   NOTHING IS PROVEN"
