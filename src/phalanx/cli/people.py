"""`phalanx link people`, `kick`, `approve` and `assign`: manage a gateway's visitors from a terminal."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from phalanx.errors import Unavailable, UsageError, did_you_mean

from .gateway_of import ask_gateway
from .invite import ROLES
from .terminal import count_of, plain, print_json, print_table, talk

HEADS = ("visitor", "name", "role", "robot", "since", "connected")
ROLE_NAMES = {role: name for name, role in ROLES.items()}
LIST = "phalanx link people lists all visitors"
Words = dict[str, Any]


def people(state: Path | None, as_json: bool) -> None:
    """Print the visitors, connected ones first."""
    reply = ask_gateway(state, "link/state", {})
    session, shared = reply["session"], [each for each in reply["visitors"] if "visitor" not in each]
    if as_json:
        print_json({key: session[key] for key in ("visitors", "open", "assign")} | {"by_shared_code": len(shared)})
        return
    names = {robot["address"]: robot["name"] for robot in reply["robots"]}
    if session["visitors"]:
        print_table(HEADS, [_row(each, names) for each in session["visitors"]])
    else:
        talk("no visitors yet")
    if shared:
        talk(f"{count_of(len(shared), 'visitor')} more with the shared code of --qrkey, without names")
    if not session["open"]:
        talk("new visitors wait for approval: phalanx link approve NAME, or --everybody")


def kick(name: str | None, everybody: bool, state: Path | None, as_json: bool) -> None:
    """Remove a visitor, or all but operators, and print what became invalid."""
    session = _session(state, name, everybody)
    if name is None:
        gone = [each for each in session["visitors"] if each["role"] != "operate"]
        ask_gateway(state, "link/everybody_out", {})
    else:
        gone = [_find(session, name)]
        ask_gateway(state, "link/remove", {"visitor": gone[0]["visitor"]})
    if as_json:
        removed = [{key: each[key] for key in ("visitor", "name")} for each in gone]
        print_json({"removed": removed, "code_valid_s": 0, "open": False})
        return
    if name is None:
        click.echo(f"{count_of(len(gone), 'visitor')} removed; their sessions and the screen's code are invalid now")
        talk("tickets stay valid")
    else:
        click.echo(f"{plain(gone[0]['name'])} removed; session, ticket and the screen's code are invalid now")
    talk("new visitors wait for approval: phalanx link approve NAME, or --everybody")
    if session["shared_code"]:
        talk("visitors with the shared code of --qrkey cannot be removed: restart the gateway without --qrkey")


def approve(name: str | None, everybody: bool, watches: bool | None, state: Path | None, as_json: bool) -> None:
    """Admit a visitor, to drive or to watch; or all who wait, and all new visitors from now on."""
    session = _session(state, name, everybody)
    if name is None:
        if watches is not None:
            raise UsageError("--everybody with --watch or --drive", "give NAME: roles change one visitor at a time")
        admitted = [each for each in session["visitors"] if each["waiting"]]
        ask_gateway(state, "link/door", {"open": True})
    else:
        admitted = [_find(session, name)]
        if watches is not None:  # first, so that a watcher cannot drive meanwhile
            role = "watch" if watches else "drive"
            ask_gateway(state, "link/role", {"visitor": admitted[0]["visitor"], "role": role})
            admitted[0]["role"] = role
        elif not admitted[0]["waiting"]:
            raise Unavailable(f"{plain(name)} is not waiting", "use --watch or --drive to change a role")
    for each in [each for each in admitted if each["waiting"]]:
        ask_gateway(state, "link/approve", {"visitor": each["visitor"]})
    if as_json:
        print_json({"approved": [{key: each[key] for key in ("visitor", "name", "role")} for each in admitted]})
        return
    for each in admitted:
        click.echo(f"{plain(each['name'])} admitted as {ROLE_NAMES[each['role']]}")
    if name is None:
        talk("new visitors are admitted without approval from now on")


def assign(name: str, robot: str | None, none: bool, state: Path | None, as_json: bool) -> None:
    """Assign a robot to a visitor, or release the visitor's robot."""
    if (robot is None) is not none:
        raise UsageError("either ROBOT or --none is needed", "phalanx link assign NAME ROBOT, or NAME --none")
    before = _find(_session(state, name), name)
    if robot is not None:
        ask_gateway(state, "link/give", {"visitor": before["visitor"], "robot": robot})
    elif before["robot"]:
        ask_gateway(state, "link/take", {"robot": before["robot"]})
    else:
        raise Unavailable(f"{plain(name)} has no robot", LIST)
    reply = ask_gateway(state, "link/state", {})
    visitor = next(each for each in reply["session"]["visitors"] if each["visitor"] == before["visitor"])
    if none and visitor["robot"]:
        hint = f"--assign one-each assigns the next one; to prevent it: phalanx link approve --watch {name}"
        raise Unavailable(f"{plain(name)} has a robot again: no other visitor waits for one", hint)
    if as_json:
        print_json({key: visitor[key] for key in ("visitor", "name", "robot")})
        return
    names = {each["address"]: each["name"] for each in reply["robots"]}
    click.echo(f"{plain(visitor['name'])} has {_robot_name(visitor, names) or 'no robot'}")


def _session(state: Path | None, name: str | None, everybody: bool = False) -> Words:
    """Return the gateway's list of visitors. Raises: UsageError: not exactly one of name and `everybody` is given."""
    if (name is None) is not everybody:
        raise UsageError("either NAME or --everybody is needed", "give one of the two")
    session: Words = ask_gateway(state, "link/state", {})["session"]
    return session


def _find(session: Words, name: str) -> Words:
    """Return the visitor with this name or number. Raises: Unavailable: none, or two."""
    visitors: list[Words] = session["visitors"]
    found = [each for each in visitors if name.casefold() in (each["name"].casefold(), str(each["visitor"]))]
    if not found:
        raise Unavailable(f"no visitor {plain(name)}", did_you_mean(name, [v["name"] for v in visitors]) + LIST)
    if len(found) > 1:
        hint = "give the other name or number of that visitor: phalanx link people"
        raise Unavailable(f"{plain(name)} is the name of one visitor and the number of another", hint)
    return found[0]


def _row(visitor: Words, names: dict[str, str]) -> list[str]:
    since = visitor["present_s"]
    role = ROLE_NAMES[visitor["role"]] + (", waiting" if visitor["waiting"] else "")
    return [
        str(visitor["visitor"]),
        plain(visitor["name"]),
        role,
        _robot_name(visitor, names) or (f"queue: {visitor['place']}" if visitor["place"] else ""),
        "" if since is None else time.strftime("%H:%M", time.localtime(time.time() - since)),
        "yes" if visitor["present"] else "no",
    ]


def _robot_name(visitor: Words, names: dict[str, str]) -> str:
    return plain(names.get(visitor["robot"]) or visitor["robot"])
