"""The files that `phalanx keys` hands out: a mission's key, sealed for each robot, and what a board is made with.

Neither is trusted: trusted nodes check the one, and take the other once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from phalanx.bti.nodes import MissionKey
from phalanx.config.written import read_at_most
from phalanx.errors import PeerError, UsageError
from phalanx.wire.table import BOARD, KEY_BYTES, MAC_BYTES

MOST_BYTES = 1 << 24  # of 65 535 robots
Read = TypeVar("Read")


def issued(
    number: int,
    sealed: Mapping[int, MissionKey],
    signers: Mapping[str, str],
    signed: Mapping[str, Any] = MappingProxyType({}),
) -> bytes:
    """Return the file of a mission's key; `signed` is the owner's word for which mission it is, if there is one."""
    robots = {robot: {"k": key.k.hex(), "r": key.r.hex(), "mac": key.mac.hex()} for robot, key in sealed.items()}
    said = {"mission": number, "signers": signers, **({"signed": dict(signed)} if signed else {}), "robots": robots}
    return json.dumps(said, indent=1).encode() + b"\n"


def read_mission_key(path: Path, robot: int) -> MissionKey:
    """Return a robot's key in a file of `issued`. Raises: UsageError: it is none, or has none for it; Unavailable."""

    def key(told: Any) -> MissionKey:
        if str(robot) not in told["robots"]:
            raise UsageError(f"{path} has no key for robot {robot}", "phalanx keys list shows who gets one")
        k, r, mac = (bytes.fromhex(told["robots"][str(robot)][name]) for name in ("k", "r", "mac"))
        if not len(k) == len(r) == KEY_BYTES or len(mac) != MAC_BYTES:
            raise ValueError("a key of another length")
        return MissionKey(k, r, _number(told), mac)

    return _read(path, key)


def read_mission_number(path: Path) -> int:
    """Return the mission's number in a file of `issued`. Raises: UsageError: it is none; Unavailable."""
    return _read(path, _number)


def _number(told: Any) -> int:
    number = int(told["mission"])
    if not 1 <= number < 1 << 32:
        raise ValueError(number)
    return number


def _read(path: Path, parse: Callable[[Any], Read]) -> Read:
    hint = "phalanx keys issue makes one"
    try:
        return parse(json.loads(read_at_most(path, MOST_BYTES, hint)))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{path} is no mission key", hint) from error


def read_board(path: Path, robot: int) -> bytes:
    """The master key in a file of `phalanx keys provision`. Raises: UsageError: it is another robot's, or none."""
    hint = "phalanx keys provision makes one"
    try:
        board = BOARD.decode(read_at_most(path, MOST_BYTES, hint))
    except PeerError as error:
        raise UsageError(f"{path} is not what a board is made with", hint) from error
    if board["id"] != robot:
        raise UsageError(f"{path} is for robot {board['id']}, and this is robot {robot}", hint)
    master: bytes = board["master"]
    return master
