"""The radio of the simulated world: what RoboRebound's ns-3 model comes to, and what may be set otherwise."""

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
    """Parameters of 802.11ax without an access point; the defaults are RoboRebound's, as ns-3 plays them.

    Reception is a disc: `range_m` follows from the path loss and the sensitivity. At MCS 3 the weakest packet that is
    detected at all still has 12 dB of SNR; whoever sets a faster MCS sets the sensitivity to match it.

    Raises: UsageError: a value is out of range.
    Source: RoboRebound §4; docs/adr/0011-radio-model.md.
    """

    tx_gain_dbm: float = within(16.02, -200, 200, "transmit power")
    loss_1m_db: float = within(36.05, -200, 200, "path loss at one metre")
    exponent: float = field(default=3.0, metadata=description("of the path loss, log-distance; a multiple of one half"))
    sensitivity_dbm: float = within(-82.0, -200, 200, "weakest preamble that is detected; carrier sense ends there too")
    broadcast_mbps: int = field(default=6, metadata=description("legacy rate of broadcasts, whatever the data mode"))
    control_mbps: int = field(default=24, metadata=description("legacy rate of acknowledgements"))
    mcs: int = within(3, 0, len(HE_BITS) - 1, "HE MCS of unicast data, 20 MHz, one stream")
    guard_us: float = field(
        default=3.2,
        metadata=description("HE guard interval. The paper names 1.6 µs; ns-3's latencies fit its default, 3.2 µs"),
    )
    capture_db: float = within(
        4.0, 0, 300, "how much stronger than all that overlaps it a broadcast must be to survive"
    )
    data_capture_db: float = within(
        12.0, 0, 300, "the same for unicast packets and acknowledgements. 300 for both: every overlap loses both"
    )
    tries: int = within(7, 1, 255, "transmissions of a unicast packet before it is given up")
    loss: float = within(
        0.0, 0.0, 0.9, "share of receptions, acknowledgements too, that fail by chance, each robot's own"
    )
    long_bytes: int = within(2048, 64, 8192, "longest packet; each robot's NIC holds one of more than 64 bytes")

    def __post_init__(self) -> None:
        check_limits(self)
        choices = {
            "broadcast_mbps": tuple(LEGACY_BITS),
            "control_mbps": tuple(LEGACY_BITS),
            "guard_us": GUARDS_US,
            "exponent": EXPONENTS,
        }
        for name, words in choices.items():
            if getattr(self, name) not in words:
                raise UsageError(f"{name} is {getattr(self, name)}", f"one of {', '.join(map(str, words))}")
        if not 0.01 <= self.range_m <= 1e6:
            raise UsageError(f"radio range is {self.range_m:g} m", "between 1 cm and 1000 km: check gain and loss")

    @property
    def range_m(self) -> float:
        """Radius of the disc, metres: everything arrives inside, nothing outside. 116.33 m by default."""
        margin_db = self.tx_gain_dbm - self.loss_1m_db - self.sensitivity_dbm
        return math.pow(10.0, margin_db / (10.0 * self.exponent))

    @property
    def data_symbol_ns(self) -> int:
        """Length of an OFDM symbol of unicast data, with its guard interval."""
        return round(1000 * (HE_SYMBOL_US + self.guard_us))
