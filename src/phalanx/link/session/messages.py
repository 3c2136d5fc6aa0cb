"""Messages inside records, as dataclasses: their fields are those of the byte table, texts checked."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, TypeAlias

from phalanx.link.topics import ADDRESS, NAME
from phalanx.wire import MalformedRecord, Record, sessions

from .errors import EndReason, Reason, Unexpected


class Role(IntEnum):
    """What a visitor may do; each includes those before."""

    WATCH = 1
    DRIVE = 2
    OPERATE = 3


@dataclass(frozen=True, slots=True)
class Join:
    """Join: a new visitor's first message."""

    name: str


@dataclass(frozen=True, slots=True)
class Ready:
    """Resume: the first message of a known visitor, and after each new key."""


@dataclass(frozen=True, slots=True)
class Stored:
    """Confirm that a resume secret is stored."""

    id: bytes


@dataclass(frozen=True, slots=True)
class Command:
    """Command one robot."""

    stop: bool
    seen: int
    digest: bytes
    robot: str
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Request:
    """Ask something of the server."""

    number: int
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Leave:
    """End the session; `keep` its robot for a while."""

    keep: bool


@dataclass(frozen=True, slots=True)
class Alive:
    """Say that this client is still there."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """Admit a visitor."""

    visitor: int
    signer: bytes
    name: str


@dataclass(frozen=True, slots=True)
class NewSecret:
    """Replace the secret to resume with."""

    secret: bytes = field(repr=False)
    lifetime_s: int


@dataclass(frozen=True, slots=True)
class Epoch:
    """Hand over the key of updates, from one update on."""

    epoch: int
    counter: int
    chain: bytes = field(repr=False)
    topic: bytes


@dataclass(frozen=True, slots=True)
class Standing:
    """Tell what the visitor may do now."""

    role: Role
    waiting: bool
    place: int
    left_ms: int
    robot: str


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer a request."""

    number: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Refused:
    """Refuse a command or a request."""

    number: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class End:
    """End the session, and say why."""

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
    """Return the bytes of a message. Raises: UsageError: a field does not fit."""
    values = {each.name: getattr(message, each.name) for each in fields(message)}
    return _CLASSES[type(message)].encode(
        **{name: value.encode() if isinstance(value, str) else value for name, value in values.items()}
    )


def decode_from_client(content: bytes) -> FromClient:
    """Return a client's message. Raises: Unexpected: no such message; MalformedRecord: it has another form."""
    message: FromClient = _decode(content, _FROM_CLIENT)
    if isinstance(message, Command | Request) and not NAME.fullmatch(message.name):
        raise MalformedRecord("a command's or request's name")
    if isinstance(message, Command) and not ADDRESS.fullmatch(message.robot):
        raise MalformedRecord("a robot's address")
    return message


def decode_from_server(content: bytes) -> FromServer:
    """Return a server's message. Raises: Unexpected: no such message; MalformedRecord: it has another form."""
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
        raise Unexpected("no message of this kind")
    values = _CLASSES[kind].decode(content)
    readers = _READERS | {"reason": Reason if kind is Refused else EndReason}
    try:
        return kind(**{name: readers.get(name, lambda x: x)(value) for name, value in values.items()})
    except ValueError as error:  # not UTF-8, or a number that means nothing
        raise MalformedRecord(f"{kind.__name__}: {error}") from error
