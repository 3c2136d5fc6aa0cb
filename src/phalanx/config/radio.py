"""Parameters of the simulated radio; the defaults correspond to RoboRebound's ns-3 model."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from phalanx.errors import UsageError

from .parameter import check_limits, description, within

# Data bits of one OFDM symbol of 20 MHz: legacy rates by Mb/s (802.11-2020 table 17-4), HE by MCS (table 27-56).
LEGACY_BITS = {6: 24, 9: 36, 12: 48, 18: 72, 24: 96, 36: 144, 48: 192, 54: 216}
HE_BITS = (117, 234, 351, 468, 702, 936, 1053, 1170, 1404, 1560, 1755, 1950)
EXPONENTS = tuple(half / 2 for half in range(4, 13))
GUARDS_US = (0.8, 1.6, 3.2)
HE_SYMBOL_US = 12.8


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioConfig:
    """Parameters of 802.11ax without an access point; the defaults are RoboRebound's, as simulated by ns-3.

    Reception is a disc: `range_m` follows from the path loss and the sensitivity. At MCS 3 the weakest detectable
    packet has 12 dB of SNR, enough to decode it. For a faster MCS, raise the sensitivity to match.

    Raises: UsageError: a value is out of range.
    Source: RoboRebound §4; docs/adr/0011-radio-model.md.
    """

    tx_gain_dbm: float = within(16.02, -200, 200, "transmit power")
    loss_1m_db: float = within(36.05, -200, 200, "path loss at one metre")
    exponent: float = field(
        default=3.0, metadata=description("exponent of the log-distance path loss, a multiple of one half")
    )
    sensitivity_dbm: float = within(
        -82.0, -200, 200, "weakest preamble that is detected, and threshold of carrier sense"
    )
    broadcast_mbps: int = field(default=6, metadata=description("legacy rate of broadcasts, whatever the data mode"))
    control_mbps: int = field(default=24, metadata=description("legacy rate of acknowledgements"))
    mcs: int = within(3, 0, len(HE_BITS) - 1, "HE MCS of unicast data, 20 MHz, one stream")
    guard_us: float = field(
        default=3.2,
        metadata=description(
            "HE guard interval. The paper states 1.6 µs, but the latencies of ns-3 fit its default of 3.2 µs"
        ),
    )
    capture_db: float = within(
        4.0, 0, 300, "smallest power ratio of a broadcast to the sum of overlapping packets at which it is received"
    )
    data_capture_db: float = within(
        12.0, 0, 300, "the same for unicast packets and acknowledgements. With 300, every overlap loses both packets"
    )
    tries: int = within(7, 1, 255, "transmissions of a unicast packet before it is dropped")
    loss: float = within(
        0.0, 0.0, 0.9, "probability that a robot loses a received packet or acknowledgement, independently of others"
    )
    long_bytes: int = within(2048, 64, 8192, "longest packet; a robot's radio buffers one packet of more than 64 bytes")

    def __post_init__(self) -> None:
        check_limits(self)
        choices = {
            "broadcast_mbps": tuple(LEGACY_BITS),
            "control_mbps": tuple(LEGACY_BITS),
            "guard_us": GUARDS_US,
            "exponent": EXPONENTS,
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise UsageError(f"{name} is {getattr(self, name)}", f"one of {', '.join(map(str, allowed))}")
        if not 0.01 <= self.range_m <= 1e6:
            raise UsageError(f"radio range is {self.range_m:g} m", "between 1 cm and 1000 km: check gain and loss")

    @property
    def range_m(self) -> float:
        """Return the radius within which packets are received, metres: 116.33 m by default."""
        margin_db = self.tx_gain_dbm - self.loss_1m_db - self.sensitivity_dbm
        return math.pow(10.0, margin_db / (10.0 * self.exponent))

    @property
    def data_symbol_ns(self) -> int:
        """Return the duration of an OFDM symbol of unicast data, including the guard interval."""
        return round(1000 * (HE_SYMBOL_US + self.guard_us))
