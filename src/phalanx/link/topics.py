"""MQTT topics: built from validated parts, and parsed (Qrkey Table I).

Only this file joins or splits topics, so no unvalidated input of a peer becomes part of one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from phalanx.errors import WrongTopic

SWARM = "0000"
ADDRESS = re.compile(r"[0-9A-Za-z_-]{1,64}", re.ASCII)
APPLICATION = re.compile(r"[0-9]{1,3}", re.ASCII)
NAME = re.compile(r"[0-9A-Za-z_-]{1,64}", re.ASCII)
CLIENT_ID = re.compile(r"[0-9A-Za-z_.:-]{1,128}", re.ASCII)


def is_address(value: object) -> bool:
    """Return whether a value is a valid robot address."""
    return isinstance(value, str) and ADDRESS.fullmatch(value) is not None


@dataclass(frozen=True, slots=True)
class CommandTopic:
    """Topic of a command for one robot."""

    address: str
    application: str
    name: str

    def __post_init__(self) -> None:
        for grammar, word in ((ADDRESS, self.address), (APPLICATION, self.application), (NAME, self.name)):
            if not grammar.fullmatch(word):
                raise WrongTopic(f"not a command topic: {word[:80]!r}")


@dataclass(frozen=True, slots=True)
class ReplyTopic:
    """Topic of the replies to one client."""

    client_id: str

    def __post_init__(self) -> None:
        if not CLIENT_ID.fullmatch(self.client_id):
            raise WrongTopic(f"not a client id: {self.client_id[:80]!r}")


SubTopic = CommandTopic | ReplyTopic | Literal["request", "notify"]


def full_topic(root: str, epoch_topic: str, sub: SubTopic) -> str:
    """Return the full topic on the broker: root, the epoch's topic, and the sub-topic."""
    match sub:
        case CommandTopic(address, application, name):
            return f"{root}/{epoch_topic}/command/{SWARM}/{address}/{application}/{name}"
        case ReplyTopic(client_id):
            return f"{root}/{epoch_topic}/reply/{client_id}"
        case word:
            return f"{root}/{epoch_topic}/{word}"


def command_filter(root: str, epoch_topic: str) -> str:
    """Return the filter for all commands of an epoch, malformed ones included: those are counted."""
    return f"{root}/{epoch_topic}/command/#"


def split_topic(root: str, epoch_topic: str, topic: str) -> SubTopic:
    """Parse a topic under this root and epoch. Raises: WrongTopic."""
    base = f"{root}/{epoch_topic}/"
    if not topic.startswith(base):
        raise WrongTopic("not under this root and epoch")
    match topic.removeprefix(base).split("/"):
        case ["request"]:
            return "request"
        case ["notify"]:
            return "notify"
        case ["reply", client_id]:
            return ReplyTopic(client_id)
        case ["command", "0000", address, application, name]:
            return CommandTopic(address, application, name)
    raise WrongTopic("no such sub-topic")
