"""Airtime of a packet from its length: headers, fragments, symbols, preamble.

Source: IEEE 802.11-2020 §17.3 (legacy OFDM), 802.11ax-2021 §27.3 (HE); results equal those of ns-3.
"""

from __future__ import annotations

from typing import NamedTuple

from phalanx.config.radio import HE_BITS, LEGACY_BITS, RadioConfig
from phalanx.kernel import kernel

_UDP, _IP, _LLC, _MAC, _FCS = 8, 20, 8, 26, 4
_DELIMITER = 4  # before each fragment in an A-MPDU
_FRAGMENT = 2272  # 802.11's MTU of 2296 less the IP header, as a multiple of 8
_SERVICE_AND_TAIL_BITS = 16 + 6
_LEGACY_PREAMBLE_US, _LEGACY_SYMBOL_US = 20, 4
_HE_PREAMBLE_US = 44
_BLOCK_ACK = 32


class Rates(NamedTuple):
    """Data bits per symbol for each kind of packet, and the length of the HE symbol in ns."""

    broadcast_bits: int
    control_bits: int
    data_bits: int
    data_symbol_ns: int


def rates_of(config: RadioConfig) -> Rates:
    """Return the rates of a configured radio."""
    return Rates(
        broadcast_bits=LEGACY_BITS[config.broadcast_mbps],
        control_bits=LEGACY_BITS[config.control_mbps],
        data_bits=HE_BITS[config.mcs],
        data_symbol_ns=config.data_symbol_ns,
    )


@kernel
def broadcast_us(rates: Rates, length: int) -> int:
    """Return the airtime in µs of a UDP broadcast of `length` bytes: 148 for 27 bytes at 6 Mb/s."""
    size = _on_the_wire(length, _IP + _LLC + _MAC + _FCS)
    return _LEGACY_PREAMBLE_US + _LEGACY_SYMBOL_US * _symbols(size, rates.broadcast_bits)


@kernel
def unicast_us(rates: Rates, length: int) -> int:
    """Return the airtime in µs of a UDP unicast of `length` bytes, all in one A-MPDU: 620 for 2000 at MCS 3."""
    size = _on_the_wire(length, _IP + _LLC + _MAC + _FCS + _DELIMITER)
    return _HE_PREAMBLE_US - (-_symbols(size, rates.data_bits) * rates.data_symbol_ns // 1000)


@kernel
def ack_us(rates: Rates) -> int:
    """Return the airtime in µs of a block acknowledgement: 32 at 24 Mb/s."""
    return _LEGACY_PREAMBLE_US + _LEGACY_SYMBOL_US * _symbols(_BLOCK_ACK, rates.control_bits)


@kernel
def _on_the_wire(length: int, per_fragment: int) -> int:
    fragments = -(-(length + _UDP) // _FRAGMENT)
    return length + _UDP + fragments * per_fragment


@kernel
def _symbols(size: int, bits: int) -> int:
    return -(-(8 * size + _SERVICE_AND_TAIL_BITS) // bits)
