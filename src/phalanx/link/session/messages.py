"""Messages inside records, as dataclasses with the fields of the byte table; strings are validated."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, TypeAlias

from phalanx.link.topics import ADDRESS, NAME
from phalanx.wire import MalformedRecord, Record, sessions

from .errors import EndReason, Reason, Unexpected


class Role(IntEnum):
    """Rights of a visitor; each role includes those before it."""

    WATCH = 1
    DRIVE = 2
    OPERATE = 3


@dataclass(frozen=True, slots=True)
class Join:
    """First message of a new visitor."""

    name: str


@dataclass(frozen=True, slots=True)
class Ready:
    """First message of a resuming visitor, and after each new key."""


@dataclass(frozen=True, slots=True)
class Stored:
    """Confirmation that a resume secret is stored."""

    id: bytes


@dataclass(frozen=True, slots=True)
class Command:
    """Command for one robot."""

    stop: bool
    seen: int
    digest: bytes
    robot: str
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Request:
    """Request to the server."""

    number: int
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Leave:
    """End of the session by the client; with `keep` its robot stays reserved for a while."""

    keep: bool


@dataclass(frozen=True, slots=True)
class Alive:
    """Keep-alive of a client."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """First message to an admitted visitor."""

    visitor: int
    signer: bytes
    name: str


@dataclass(frozen=True, slots=True)
class NewSecret:
    """New resume secret."""

    secret: bytes = field(repr=False)
    lifetime_s: int


@dataclass(frozen=True, slots=True)
class Epoch:
    """Key of updates, from one update on."""

    epoch: int
    counter: int
    chain: bytes = field(repr=False)
    topic: bytes


@dataclass(frozen=True, slots=True)
class Standing:
    """Current rights of the visitor."""

    role: Role
    waiting: bool
    place: int
    left_ms: int
    robot: str


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer to a request."""

    number: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Refused:
    """Refusal of a command or a request."""

    number: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class End:
    """End of the session by the server, with the reason."""

    reason: EndReason


FromClient: TypeAlias = Join | Ready | Stored | Command | Request | Leave | Alive
FromServer: TypeAlias = Welcome | NewSecret | Epoch | Standing | Reply | Refused | End
_CLASSES: dict[type[Any], Record] = {
    Join: sessions.JOIN,
    Ready: sessions.READY,
    Stored: sessions.STORED,
    Command: sessions.COMMAND,
    Request: sessions.LINK_REQUEST,
    Leave: sessions.LEAVE,
    Alive: sessions.ALIVE,
    Welcome: sessions.WELCOME,
    NewSecret: sessions.SECRET,
    Epoch: sessions.EPOCH,
    Standing: sessions.STANDING,
    Reply: sessions.REPLY,
    Refused: sessions.REFUSED,
    End: sessions.END,
}
_FROM_CLIENT = {_CLASSES[kind].tag: kind for kind in FromClient.__args__}
_FROM_SERVER = {_CLASSES[kind].tag: kind for kind in FromServer.__args__}


def encode(message: FromClient | FromServer) -> bytes:
    """Encode a message. Raises: UsageError: a field does not fit."""
    values = {each.name: getattr(message, each.name) for each in fields(message)}
    return _CLASSES[type(message)].encode(
        **{name: value.encode() if isinstance(value, str) else value for name, value in values.items()}
    )


def decode_from_client(content: bytes) -> FromClient:
    """Decode a client's message. Raises: Unexpected: unknown kind; MalformedRecord: not valid."""
    message: FromClient = _decode(content, _FROM_CLIENT)
    if isinstance(message, Command | Request) and not NAME.fullmatch(message.name):
        raise MalformedRecord("the name of a command or request is not valid")
    if isinstance(message, Command) and not ADDRESS.fullmatch(message.robot):
        raise MalformedRecord("the address of a robot is not valid")
    return message


def decode_from_server(content: bytes) -> FromServer:
    """Decode a server's message. Raises: Unexpected: unknown kind; MalformedRecord: not valid."""
    message: FromServer = _decode(content, _FROM_SERVER)
    return message


def _flag(value: int) -> bool:
    if value > 1:
        raise ValueError(value)
    return bool(value)


_READERS: dict[str, Any] = {
    "name": bytes.decode,
    "robot": bytes.decode,
    "keep": _flag,
    "role": Role,
    "stop": _flag,
    "waiting": _flag,
}


def _decode(content: bytes, known: dict[int | None, type[Any]]) -> Any:
    kind = known.get(next(iter(content), None))
    if kind is None:
        raise Unexpected("unknown kind of message")
    values = _CLASSES[kind].decode(content)
    readers = _READERS | {"reason": Reason if kind is Refused else EndReason}
    try:
        return kind(**{name: readers.get(name, lambda x: x)(value) for name, value in values.items()})
    except ValueError as error:  # not UTF-8, or not a member of the enumeration
        raise MalformedRecord(f"{kind.__name__}: {error}") from error
