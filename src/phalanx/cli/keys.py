"""Create and use key files, for `phalanx keys`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from phalanx.daemon.run import mission_in
from phalanx.daemon.signed_mission import sign_mission
from phalanx.errors import UsageError
from phalanx.net.keyring import Keys, create, open_keyring, pem
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.net.private_file import write_private
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import BOARD

from .credentials import passphrase, passphrase_of
from .terminal import print_json, talk


def make(file: Path, name: str, passphrase_file: Path | None) -> None:
    """Create a key file."""
    _check_new(file)
    create(file, name or file.stem, passphrase(passphrase_file, new=True))
    talk(f"created {file}, keys of {name or file.stem}; back it up, and store the passphrase elsewhere")


def provision(file: Path, robot: int, out: Path, passphrase_file: Path | None) -> None:
    """Create one robot's master key and write it to a board file. Works once per robot."""
    _check_new(out)
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        master = keys.provision(robot, today())
    write_private(out, BOARD.encode(id=robot, master=master))
    talk(
        f"{out} has the number and the master key of robot {robot}: destroy it once the trusted nodes have them. "
        "A gateway with nodes in a process needs it at each start: make it readable by that user only"
    )


def issue(file: Path, out: Path, rotate: bool, mission: str | None, passphrase_file: Path | None) -> None:
    """Issue the next mission's key, sealed per robot; `rotate` also replaces the keys of orders, stops and advice."""
    _check_new(out)
    scenario = mission_in(Path(), mission) if mission else None
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        if rotate and scenario:
            _check_signers_kept(keys, scenario)
        number, sealed = keys.issue()
        if rotate:
            for purpose in ("orders", "stops", "advice"):
                keys.renew(purpose)
        signers = {purpose: keys.public(purpose) for purpose in keys.signers}
        signed = sign_mission(scenario, number, keys.signer("missions")).as_json if scenario else {}
    write_private(out, encode_mission_key_file(number, sealed, signers, signed))
    talk(f"{out} contains the key of mission {number}, sealed for {len(sealed)} robots")


def _check_signers_kept(keys: Keys, scenario: Scenario) -> None:
    """Check that the mission names no key that is about to be replaced. Raises: UsageError."""
    named = {"orders": scenario.gateway_key, "stops": scenario.operator_key, "advice": scenario.guard.adviser_key}
    for purpose, key in named.items():
        if key and key.lower() == keys.public(purpose):
            raise UsageError(
                f"the mission names the key that signs {purpose}, which --rotate replaces",
                "rotate without --mission, put the new keys of phalanx keys list into the mission, then issue again",
            )


def retire(file: Path, robot: int, passphrase_file: Path | None) -> None:
    """Exclude a robot from the next mission on."""
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        keys.retire(robot, today())
    talk(f"robot {robot} gets no more mission keys; in the running mission it continues, and counts towards f_max")


def renew_passphrase(file: Path, passphrase_file: Path | None, new_passphrase_file: Path | None) -> None:
    """Encrypt the file with a new passphrase."""
    old = passphrase_of(file, passphrase_file)
    with open_keyring(file, old, passphrase(new_passphrase_file, new=True)):
        pass
    talk(f"{file} is encrypted with the new passphrase; older copies still open with the old one")


def export(file: Path, signer: str, out: Path, public: bool, passphrase_file: Path | None) -> None:
    """Write a signing key, or its public key, as PEM."""
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        key = keys.signer(signer)
    checks = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    write_private(out, checks if public else pem(key))
    talk(f"{out}: {'verifies' if public else 'signs'} {signer}")


def show(file: Path, as_json: bool, passphrase_file: Path | None) -> None:
    """List the robots that have keys, and the public keys of the signers."""
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        signers = {purpose: keys.public(purpose) for purpose in keys.signers}
    rows = [{"robot": robot, "given": about.given, "retired": about.retired} for robot, about in keys.robots.items()]
    if as_json:
        print_json({"name": keys.name, "missions": keys.missions, "signers": signers, "robots": rows})
        return
    click.echo(f"{keys.name}: {keys.missions} mission keys issued")
    for purpose, public in signers.items():
        click.echo(f"signs {purpose}: {public}")
    for robot, about in sorted(keys.robots.items()):
        retired = f", retired {about.retired}" if about.retired else ""
        click.echo(f"robot {robot}: master key created {about.given}{retired}")


def _check_new(out: Path) -> None:
    # Checked before a mission number is used up. The write itself also refuses to overwrite.
    if out.exists() or not out.parent.is_dir():
        raise UsageError(f"{out} exists" if out.exists() else f"no folder {out.parent}", "use another name")


def today() -> str:
    """Return today's ISO date, UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%d")
