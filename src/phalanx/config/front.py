"""Limits of the front end: what strangers and visitors may use of it. Source: docs/spec/session.md."""

from __future__ import annotations

from dataclasses import dataclass, fields

from phalanx.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontConfig:
    """Limits of connections, messages and times.

    An address is an IPv4 address, or the /64 of an IPv6 address. A newcomer is a connection that was not admitted yet.

    Raises: UsageError: a value is not positive.
    """

    # connections
    connections_max: int = 4096
    accepts_per_s: float = 4000.0  # taken from the system, and refused if too many wait
    arrivals_per_s: float = 300.0  # connections that are served, of all addresses
    arrivals_waiting_max: int = 1024  # accepted by the system, and not served yet
    # Of one address: enough at once for a class behind a router. An admission gives back what it used, and a connection
    # that comes to nothing costs more, so that addresses of attackers soon have nothing left.
    arrivals_at_once_per_address: float = 300.0
    arrivals_per_s_per_address: float = 5.0
    given_back: float = 12.0  # with an admission, connections and requests
    cost_of_silence: float = 8.0  # of a connection that asked nothing in time, or sent no message
    cost_of_refusal: float = 40.0  # of one that the gateway refused
    newcomers_max: int = 2048  # more push out the oldest of the address that has most
    newcomers_max_per_address: int = 128
    # requests for the page and its files
    requests_per_s: float = 600.0
    requests_at_once_per_address: float = 400.0
    requests_per_s_per_address: float = 20.0
    # messages to the gateway
    message_bytes: int = 16 * 1024 + 26  # plaintext, head and tag of a record
    newcomer_message_bytes: int = 1024
    messages_per_s: float = 40.0  # of a connection; a visitor has 20 commands and 10 requests a second
    messages_at_once: float = 80.0
    bytes_per_s: float = 64 * 1024.0
    bytes_at_once: float = 128 * 1024.0
    newcomers_share: float = 0.25  # of the gateway's time, for messages of all newcomers
    in_flight: int = 256  # messages that the gateway has not processed yet
    newcomers_in_flight: int = 4
    # messages to clients
    unsent_bytes: int = 2 * 1024 * 1024  # of a connection
    unsent_bytes_in_all: int = 64 * 1024 * 1024
    # times
    head_s: float = 5.0  # for a request
    first_message_s: float = 5.0
    admission_s: float = 15.0
    unread_s: float = 5.0  # for which a message to one client may stay unsent
    stalled_s: float = 20.0  # the same, of an update
    closing_s: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value <= 0:
                raise UsageError(f"{field.name} is {value}", "a positive number")
        if self.bytes_at_once < self.message_bytes:
            raise UsageError(f"bytes_at_once is {self.bytes_at_once:g}", "at least message_bytes")
