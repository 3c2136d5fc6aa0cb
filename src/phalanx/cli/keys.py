"""Create and use files of keys, for `phalanx keys`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from phalanx.daemon.run import mission_in
from phalanx.daemon.signed_mission import sign_mission
from phalanx.errors import UsageError
from phalanx.net.keyring import Keys, create, opened, pem
from phalanx.net.mission_key import issued
from phalanx.net.private_file import write_private
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import BOARD

from .credentials import passphrase, passphrase_of
from .terminal import print_json, talk


def make(file: Path, name: str, passphrase_file: Path | None) -> None:
    """A new file."""
    _not_there(file)
    create(file, name or file.stem, passphrase(passphrase_file, new=True))
    talk(f"{file} holds the keys of {name or file.stem}: keep a copy, and the passphrase apart from it")


def provision(file: Path, robot: int, out: Path, passphrase_file: Path | None) -> None:
    """One robot's master key, once."""
    _not_there(out)
    with opened(file, passphrase_of(file, passphrase_file)) as keys:
        master = keys.provision(robot, today())
    write_private(out, BOARD.encode(id=robot, master=master))
    talk(
        f"{out} has the number and the master key of robot {robot}: destroy it once its trusted nodes have them. "
        "A gateway whose nodes are a process needs it at each start: keep it for its user alone"
    )


def issue(file: Path, out: Path, rotate: bool, mission: str | None, passphrase_file: Path | None) -> None:
    """The next mission's key, sealed for each robot; `rotate`: and new keys that sign orders, stops and advice."""
    _not_there(out)
    scenario = mission_in(Path(), mission) if mission else None
    with opened(file, passphrase_of(file, passphrase_file)) as keys:
        if rotate and scenario:
            _not_replaced(keys, scenario)
        number, sealed = keys.issue()
        if rotate:
            for who in ("orders", "stops", "advice"):
                keys.renew(who)
        signers = {who: keys.public(who) for who in keys.signers}
        signed = sign_mission(scenario, number, keys.signer("missions")).told if scenario else {}
    write_private(out, issued(number, sealed, signers, signed))
    talk(f"{out} holds the key of mission {number}, sealed for {len(sealed)} robots")


def _not_replaced(keys: Keys, scenario: Scenario) -> None:
    """Nothing, if the mission names no key that is to be replaced. Raises: UsageError: robots would obey nobody."""
    named = {"orders": scenario.gateway_key, "stops": scenario.operator_key, "advice": scenario.guard.adviser_key}
    for who, key in named.items():
        if key and key.lower() == keys.public(who):
            raise UsageError(
                f"the mission names the key that signs {who}, which --rotate replaces",
                "rotate without --mission, name the new keys of phalanx keys list in it, and issue again with it",
            )


def retire(file: Path, robot: int, passphrase_file: Path | None) -> None:
    """Leave a robot out from the next mission on."""
    with opened(file, passphrase_of(file, passphrase_file)) as keys:
        keys.retire(robot, today())
    talk(f"robot {robot} gets no mission key any more; in the mission that runs it goes on, and counts as one of f_max")


def renew_passphrase(file: Path, passphrase_file: Path | None, new_passphrase_file: Path | None) -> None:
    """Seal the file anew."""
    old = passphrase_of(file, passphrase_file)
    with opened(file, old, passphrase(new_passphrase_file, new=True)):
        pass
    talk(f"{file} is sealed with the new passphrase; copies of it still open with the old one")


def export(file: Path, signer: str, out: Path, public: bool, passphrase_file: Path | None) -> None:
    """A key that signs, as PEM."""
    with opened(file, passphrase_of(file, passphrase_file)) as keys:
        key = keys.signer(signer)
    checks = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    write_private(out, checks if public else pem(key))
    talk(f"{out} {'checks' if public else 'signs'} {signer}")


def show(file: Path, as_json: bool, passphrase_file: Path | None) -> None:
    """Who has keys."""
    with opened(file, passphrase_of(file, passphrase_file)) as keys:
        signers = {who: keys.public(who) for who in keys.signers}
    rows = [{"robot": robot, "given": about.given, "retired": about.retired} for robot, about in keys.robots.items()]
    if as_json:
        print_json({"name": keys.name, "missions": keys.missions, "signers": signers, "robots": rows})
        return
    click.echo(f"{keys.name}: {keys.missions} mission keys issued")
    for who, public in signers.items():
        click.echo(f"signs {who}: {public}")
    for robot, about in sorted(keys.robots.items()):
        retired = f", retired {about.retired}" if about.retired else ""
        click.echo(f"robot {robot}: master key given {about.given}{retired}")


def _not_there(out: Path) -> None:
    # Asked before a number is used up; that it is so still when it is written is seen to there.
    if out.exists() or not out.parent.is_dir():
        raise UsageError(f"{out} is there already" if out.exists() else f"no folder {out.parent}", "another name")


def today() -> str:
    """An ISO date, UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%d")
