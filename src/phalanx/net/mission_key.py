"""Files of `phalanx keys`: a mission's key, blinded for each robot, and the data for a board's manufacture.

This process trusts neither: trusted nodes check mission keys, and accept a master key once.
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

MOST_BYTES = 1 << 24  # enough for 65 535 robots
Read = TypeVar("Read")


def encode_mission_key_file(
    number: int,
    sealed: Mapping[int, MissionKey],
    signers: Mapping[str, str],
    signed: Mapping[str, Any] = MappingProxyType({}),
) -> bytes:
    """Return the content of a mission key file; `signed` is the owner's signed statement about the mission, if any."""
    robots = {robot: {"k": key.k.hex(), "r": key.r.hex(), "mac": key.mac.hex()} for robot, key in sealed.items()}
    content = {"mission": number, "signers": signers, **({"signed": dict(signed)} if signed else {}), "robots": robots}
    return json.dumps(content, indent=1).encode() + b"\n"


def read_mission_key(path: Path, robot: int) -> MissionKey:
    """Read a robot's key from a mission key file. Raises: UsageError: not valid, or no key for it; Unavailable."""

    def key(content: Any) -> MissionKey:
        if str(robot) not in content["robots"]:
            hint = "see phalanx keys list for the robots that get one"
            raise UsageError(f"{path} has no key for robot {robot}", hint)
        k, r, mac = (bytes.fromhex(content["robots"][str(robot)][name]) for name in ("k", "r", "mac"))
        if not len(k) == len(r) == KEY_BYTES or len(mac) != MAC_BYTES:
            raise ValueError("wrong length of a key or MAC")
        return MissionKey(k, r, _number(content), mac)

    return _read(path, key)


def read_mission_number(path: Path) -> int:
    """Read the mission's number from a mission key file. Raises: UsageError: not valid; Unavailable."""
    return _read(path, _number)


def _number(content: Any) -> int:
    number = int(content["mission"])
    if not 1 <= number < 1 << 32:
        raise ValueError(number)
    return number


def _read(path: Path, parse: Callable[[Any], Read]) -> Read:
    hint = "make one with phalanx keys issue"
    try:
        return parse(json.loads(read_at_most(path, MOST_BYTES, hint)))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{path} is not a mission key file", hint) from error


def read_board(path: Path, robot: int) -> bytes:
    """Read the master key from a board file. Raises: UsageError: for another robot, or not valid; Unavailable."""
    hint = "make one with phalanx keys provision"
    try:
        board = BOARD.decode(read_at_most(path, MOST_BYTES, hint))
    except PeerError as error:
        raise UsageError(f"{path} is not a board file", hint) from error
    if board["id"] != robot:
        raise UsageError(f"{path} is for robot {board['id']}, not for robot {robot}", hint)
    master: bytes = board["master"]
    return master
