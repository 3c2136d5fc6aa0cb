"""Parameters of the link in mode session: times, sizes and limits. Source: docs/spec/session.md."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from phalanx.errors import UsageError

Assign = Literal["free", "one-each", "tickets"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionConfig:
    """Limits that both ends of a session keep, and limits of a server on its clients.

    Raises: UsageError: a value is not positive.
    """

    root: str = ""  # first part of every topic; empty on direct
    broker: str = ""  # URL as in the QR code; empty on direct
    # times
    handshake_ms: int = 5_000  # longest time from the first message to the first record
    rekey_ms: int = 600_000  # after which a client negotiates new keys
    key_max_ms: int = 1_200_000  # after which a server ends a session without new keys
    overlap_ms: int = 10_000  # for which the previous keys are accepted
    silent_ms: int = 15_000  # without a record, after which a session on a broker ends
    code_ms: int = 900_000  # lifetime of an open code
    code_overlap_ms: int = 120_000  # for which the previous open code is accepted
    epoch_ms: int = 900_000  # lifetime of a key of updates
    epoch_notice_ms: int = 10_000  # how long before its use visitors receive the next key of updates
    late_ms: int = 1_000  # largest age of the update that a command is based on
    lease_ms: int = 10_000  # without a command, after which a robot is released
    turn_ms: int = 120_000  # with a robot, while other visitors queue
    resume_s: int = 8 * 3600  # for which a resume secret is valid; on plain http an hour
    # sizes
    max_to_server_bytes: int = 16 * 1024  # plaintext of a record, with its padding
    max_to_client_bytes: int = 1024 * 1024
    # limits
    assign: Assign = "free"
    commands_per_s: int = 20  # per visitor
    requests_per_s: int = 10  # per visitor
    handshakes_at_once: int = 30  # per visitor, for new keys or to resume
    handshakes_per_min: int = 12
    joins_per_address: int = 1024  # at once and per hour, without a ticket; on direct only
    connections_max: int = 4096
    visitors_max: int = 4096  # that may resume
    waiting_max: int = 256  # for approval
    tickets_max: int = 4096
    bad_records_max: int = 64  # after which a direct connection is closed
    hellos_per_s: int = 500  # on a broker, with tickets, and as many to resume
    open_hellos_per_s: int = 20  # on a broker, with the open code
    open_hellos_at_once: int = 100
    room_tries: int = 120  # per hour, for each code that an operator makes
    room_tries_per_address: int = 10

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, int) and value <= 0:
                raise UsageError(f"{field.name} is {value}", "a positive number")
