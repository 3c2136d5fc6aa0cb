"""Limits of the front end against overload by newcomers and visitors. Source: docs/spec/session.md."""

from __future__ import annotations

from dataclasses import dataclass, fields

from phalanx.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontConfig:
    """Limits of connections, messages and times.

    An address is an IPv4 address, or the /64 of an IPv6 address. A newcomer is a connection that is not admitted yet.

    Raises: UsageError: a value is not positive.
    """

    # connections
    connections_max: int = 4096
    accepts_per_s: float = 4000.0  # connections accepted from the system, and closed if too many wait
    arrivals_per_s: float = 300.0  # connections served, of all addresses
    arrivals_waiting_max: int = 1024  # accepted by the system, and not served yet
    # Token bucket of each address, with a burst for a class behind one router. Each connection takes one token. An
    # admission refunds tokens, and a failed connection takes more, so attackers' addresses soon run out of them.
    arrivals_at_once_per_address: float = 300.0
    arrivals_per_s_per_address: float = 5.0
    given_back: float = 12.0  # tokens refunded with an admission, for connections and for requests
    cost_of_silence: float = 8.0  # of a connection that sent no request or message in time
    cost_of_refusal: float = 40.0  # of a connection that the gateway refused
    newcomers_max: int = 2048  # beyond this, the oldest newcomer of the address with the most is closed
    newcomers_max_per_address: int = 128
    # requests for the page and its files
    requests_per_s: float = 600.0
    requests_at_once_per_address: float = 400.0
    requests_per_s_per_address: float = 20.0
    # messages to the gateway
    message_bytes: int = 16 * 1024 + 26  # plaintext, header and tag of a record
    newcomer_message_bytes: int = 1024
    messages_per_s: float = 40.0  # of a connection; a visitor has 20 commands and 10 requests a second
    messages_at_once: float = 80.0
    bytes_per_s: float = 64 * 1024.0
    bytes_at_once: float = 128 * 1024.0
    newcomers_share: float = 0.25  # share of the gateway's time for messages of newcomers
    in_flight: int = 256  # messages that the gateway has not processed yet
    newcomers_in_flight: int = 4
    # messages to clients
    unsent_bytes: int = 2 * 1024 * 1024  # per connection
    unsent_bytes_in_all: int = 64 * 1024 * 1024
    # times
    head_s: float = 5.0  # for the header of a request
    first_message_s: float = 5.0
    admission_s: float = 15.0
    unread_s: float = 5.0  # for which a message to one client may wait to be sent
    stalled_s: float = 20.0  # for which an update may wait to be sent
    closing_s: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value <= 0:
                raise UsageError(f"{field.name} is {value}", "a positive number")
        if self.bytes_at_once < self.message_bytes:
            raise UsageError(f"bytes_at_once is {self.bytes_at_once:g}", "at least message_bytes")
