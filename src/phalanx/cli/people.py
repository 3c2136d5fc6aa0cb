"""`phalanx link people`, `kick`, `approve` and `assign`: an operator's hands on visitors, from a terminal."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from phalanx.errors import Unavailable, UsageError, did_you_mean

from .gateway_of import ask_gateway
from .invite import ROLES
from .terminal import counted, plain, print_json, print_table, talk

HEADS = ("visitor", "name", "role", "robot", "since", "connected")
ROLE_NAMES = {role: name for name, role in ROLES.items()}
LIST = "phalanx link people lists them"
Words = dict[str, Any]


def people(state: Path | None, as_json: bool) -> None:
    """Prints the visitors, with whoever is connected first."""
    told = ask_gateway(state, "link/state", {})
    session, shared = told["session"], [each for each in told["visitors"] if "visitor" not in each]
    if as_json:
        print_json({key: session[key] for key in ("visitors", "open", "assign")} | {"by_shared_code": len(shared)})
        return
    names = {robot["address"]: robot["name"] for robot in told["robots"]}
    if session["visitors"]:
        print_table(HEADS, [_row(each, names) for each in session["visitors"]])
    else:
        talk("nobody yet")
    if shared:
        talk(f"{counted(len(shared), 'visitor')} more by the shared code of --qrkey, who have no names")
    if not session["open"]:
        talk("newcomers wait until they are let in: phalanx link approve NAME, or --everybody")


def kick(name: str | None, everybody: bool, state: Path | None, as_json: bool) -> None:
    """Removes a visitor, or all but operators, and says what stopped working."""
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
        click.echo(f"{counted(len(gone), 'visitor')} out; their sessions and the code on the screen ended now")
        talk("tickets stay valid")
    else:
        click.echo(f"{plain(gone[0]['name'])} is out; its session, its ticket and the code on the screen ended now")
    talk("newcomers wait until they are let in: phalanx link approve NAME, or --everybody")
    if session["shared_code"]:
        talk("nobody can be removed who has the shared code of --qrkey: end the gateway, and start it without")


def approve(name: str | None, everybody: bool, watches: bool | None, state: Path | None, as_json: bool) -> None:
    """Lets a visitor in, to drive or to watch; or all who wait, and newcomers from now on."""
    session = _session(state, name, everybody)
    if name is None:
        if watches is not None:
            raise UsageError("--everybody with --watch or --drive", "give NAME: one visitor's role is changed")
        admitted = [each for each in session["visitors"] if each["waiting"]]
        ask_gateway(state, "link/door", {"open": True})
    else:
        admitted = [_find(session, name)]
        if watches is not None:  # first: whoever is to watch must not drive meanwhile
            role = "watch" if watches else "drive"
            ask_gateway(state, "link/role", {"visitor": admitted[0]["visitor"], "role": role})
            admitted[0]["role"] = role
        elif not admitted[0]["waiting"]:
            raise Unavailable(f"{plain(name)} does not wait", "--watch and --drive change what a visitor may do")
    for each in [each for each in admitted if each["waiting"]]:
        ask_gateway(state, "link/approve", {"visitor": each["visitor"]})
    if as_json:
        print_json({"approved": [{key: each[key] for key in ("visitor", "name", "role")} for each in admitted]})
        return
    for each in admitted:
        click.echo(f"{plain(each['name'])} is in, as {ROLE_NAMES[each['role']]}")
    if name is None:
        talk("newcomers are let in from now on")


def assign(name: str, robot: str | None, none: bool, state: Path | None, as_json: bool) -> None:
    """Gives a visitor a robot, or takes the one it has."""
    if (robot is None) is not none:
        raise UsageError("a visitor, and no robot", "phalanx link assign NAME ROBOT, or --none instead of ROBOT")
    before = _find(_session(state, name), name)
    if robot is not None:
        ask_gateway(state, "link/give", {"visitor": before["visitor"], "robot": robot})
    elif before["robot"]:
        ask_gateway(state, "link/take", {"robot": before["robot"]})
    else:
        raise Unavailable(f"{plain(name)} has no robot", LIST)
    told = ask_gateway(state, "link/state", {})
    visitor = next(each for each in told["session"]["visitors"] if each["visitor"] == before["visitor"])
    if none and visitor["robot"]:
        hint = f"--assign one-each gives it the next one; to take it for good: phalanx link approve --watch {name}"
        raise Unavailable(f"{plain(name)} has a robot again, as nobody else waits for one", hint)
    if as_json:
        print_json({key: visitor[key] for key in ("visitor", "name", "robot")})
        return
    names = {each["address"]: each["name"] for each in told["robots"]}
    click.echo(f"{plain(visitor['name'])} has {_robot_name(visitor, names) or 'no robot'}")


def _session(state: Path | None, name: str | None, everybody: bool = False) -> Words:
    """Return what the gateway says of its visitors. Raises: UsageError: not either one of them or all are meant."""
    if (name is None) is not everybody:
        raise UsageError("NAME or --everybody", "give one of the two")
    session: Words = ask_gateway(state, "link/state", {})["session"]
    return session


def _find(session: Words, called: str) -> Words:
    """Return the visitor of this name or number. Raises: Unavailable: there is none, or more than one."""
    visitors: list[Words] = session["visitors"]
    found = [each for each in visitors if called.casefold() in (each["name"].casefold(), str(each["visitor"]))]
    if not found:
        raise Unavailable(f"no visitor {plain(called)}", did_you_mean(called, [v["name"] for v in visitors]) + LIST)
    if len(found) > 1:
        hint = "give the name or the number of either; the operator's page has both"
        raise Unavailable(f"{plain(called)} is the name of one visitor and the number of another", hint)
    return found[0]


def _row(visitor: Words, names: dict[str, str]) -> list[str]:
    since = visitor["present_s"]
    role = ROLE_NAMES[visitor["role"]] + (", waits" if visitor["waiting"] else "")
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
