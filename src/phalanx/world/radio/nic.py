"""One robot's network card: carrier sense, back-off and reception. The channel between the NICs is in `channel`."""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Records, layout
from phalanx.kernel import kernel

# Channel access as in ns-3: best-effort class only (AIFSN 3), slots of 9 µs, CWmin 15 and CWmax 1023.
SLOT_US = 9
SIFS_US = 16
AIFS_US = SIFS_US + 3 * SLOT_US
WINDOW_MIN, WINDOW_MAX = 15, 1023
# Detecting a preamble takes 4 µs: packets that start within that time do not sense each other.
SENSE_US = 4
NEVER = -1
_LONG_AGO = -(1 << 40)
_STREAM = 0x4E49  # separates the radio's random stream from others of the same seed

NIC = layout(
    "heard_until i8",  # end of the last packet in range, µs
    "hears_from i8",  # packet that it is receiving: start,
    "hears_until i8",  # and end
    "busy_until i8",  # end of busy channel: own and others' packets, and their acknowledgements
    "own_until i8",  # end of its own last packet
    "attempt_at i8",  # next attempt, or NEVER
    "random u8",  # xorshift64
    "hears i4",  # sender of the packet that it is receiving, or NOBODY
    "strength f8",  # power of that packet here; 1 is the power at one metre
    "noise f8",  # power of all other packets since the channel was last silent
    "slots i4",  # back-off: idle slots left to wait
    "window tries i4",
    "head i4",  # first packet in the ring
    "waiting i4",  # packets in the ring
    "due i4",  # robots in range at the start of the packet
    "long_row i4",  # row of the longer packet, if any
    "queued u1",  # an ATTEMPT is in the event queue
    "long_used u1",
    "delivered u1",  # the destination has received it; the acknowledgement may have been lost
    "off u1",
    "pad 16u1",  # to two whole cache lines
)
Nic: TypeAlias = Annotated[Any, Records(NIC, 0)]


def make_nics(robots: int, seed: int) -> NDArray[np.void]:
    """Return (robots,) records of NIC: an idle channel, and a random state for each robot."""
    nic = np.zeros(robots, NIC).view(np.recarray)
    for name in ("heard_until", "hears_until", "busy_until", "own_until"):
        nic[name] = _LONG_AGO
    nic["attempt_at"] = NEVER
    nic["window"] = WINDOW_MIN
    drawn = np.random.SeedSequence([seed, _STREAM]).generate_state(robots, np.uint64)
    nic["random"] = drawn | np.uint64(1)  # xorshift would remain at 0
    return nic


@kernel
def listen(nic: Nic, sender: int, strong: float, capture: float, now_us: int, end_us: int) -> bool:
    """Return whether the NIC locks onto a packet that starts; otherwise the packet counts as noise.

    A preamble is detected if its power exceeds `capture` times the noise.
    Source: ns-3's ThresholdPreambleDetectionModel, without packet capture; docs/adr/0011.
    """
    if nic.heard_until <= now_us:
        nic.noise = 0.0
    nic.heard_until = max(nic.heard_until, end_us)
    deaf = nic.own_until > now_us
    free = nic.hears_until <= now_us
    if not deaf and not free and now_us < nic.hears_from + SENSE_US and strong > nic.strength:
        nic.noise += nic.strength  # simultaneous preambles: the stronger one is detected
    elif deaf or not free or strong <= capture * nic.noise:
        nic.noise += strong
        return False
    nic.hears, nic.strength, nic.hears_from, nic.hears_until = sender, strong, now_us, end_us
    return True


@kernel
def received(nic: Nic, sender: int, now_us: int, capture: float, loss: float) -> bool:
    """Return whether the NIC received the packet that ends: it was locked onto it, and the noise was low enough.

    A share `loss` of those packets is lost at random, by the NIC's own state; without loss no random number is drawn.

    Source: docs/adr/0011.
    """
    # Compare the time too: if the robot left the sender's range during a packet, `hears` is outdated.
    heard = nic.hears == sender and nic.hears_until == now_us and not nic.off
    if not heard or nic.strength <= capture * nic.noise:
        return False
    return bool(loss <= 0.0 or np.float64(_step(nic) >> np.uint64(11)) >= loss * 2.0**53)


@kernel
def strength(square: float, half_exponents: int) -> float:
    """Return the signal strength at a squared distance, m²; 1 within one metre.

    Source: ns-3's LogDistancePropagationLossModel.
    """
    # Roots and products only: `**` may differ between machines by a bit.
    root, loss = math.sqrt(math.sqrt(max(square, 1.0))), 1.0
    for _ in range(half_exponents):
        loss *= root
    return 1.0 / loss


@kernel
def hold(nic: Nic, now_us: int, until_us: int) -> None:
    """Count the idle slots so far, and postpone the NIC's attempt until the channel is free again.

    Source: IEEE 802.11-2020 §10.23.2.4.
    """
    idle_from = nic.busy_until + AIFS_US
    if now_us > idle_from:
        nic.slots -= min(int(nic.slots), (now_us - idle_from) // SLOT_US)
    nic.busy_until = max(nic.busy_until, until_us)
    if nic.attempt_at >= now_us + SENSE_US:
        nic.attempt_at = nic.busy_until + AIFS_US + int(nic.slots) * SLOT_US


@kernel
def draw(nic: Nic) -> int:
    """Draw a back-off in slots from the NIC's random state and window."""
    return int(_step(nic) >> np.uint64(33)) & int(nic.window)


@kernel
def _step(nic: Nic) -> np.uint64:
    """Return the NIC's next 64 random bits. Source: Marsaglia, Xorshift RNGs (2003)."""
    state: np.uint64 = nic.random
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    nic.random = state
    return state
