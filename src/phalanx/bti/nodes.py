"""The trusted nodes of N robots, and the operator's side of their mission key.

`Nodes` owns their memory; kernels take `snode` and `anode` rows and call bti.trusted. Only this file creates nodes.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.config.bti import CHECKPOINT_BYTES, NEIGHBOUR_BYTES, REQUEST_OVERHEAD_BYTES
from phalanx.config.radio import RadioConfig
from phalanx.errors import PeerError, UsageError
from phalanx.pool import lines
from phalanx.wire.airtime import broadcast_us, rates_of, unicast_us
from phalanx.wire.fields import row
from phalanx.wire.table import AUDIT_FRAGMENT, AUDIT_TOKEN, HASH_BYTES, KEY_BYTES, MAC_BYTES, MKEY, STATE

from . import trusted


class Refused(PeerError):
    """Error: a trusted node refused a call, with a code of trusted.REASONS, and its state is unchanged."""

    def __init__(self, code: int) -> None:
        super().__init__(f"a trusted node refused a call: {trusted.REASONS[code]}")
        self.code = code
        self.reason = trusted.REASONS[code]  # type: ignore[misc]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits set in a node at manufacture, in the order of phx_limits in firmware/include/phx.h.

    Source: docs/spec/rebound-nodes.md.
    """

    f_max: int
    t_val_ms: int
    batch_size: int
    bucket_capacity: int
    bucket_period_ms: int
    send_us_per_s: int
    send_capacity_us: int
    audit_us_per_s: int
    audit_capacity_us: int
    airtime_fixed_us: int
    airtime_ns_per_byte_broadcast: int
    airtime_ns_per_byte_unicast: int

    @classmethod
    def of(cls, config: BtiConfig, fixed_us: int, ns_per_byte_broadcast: int, ns_per_byte_unicast: int) -> Limits:
        """Return limits that suffice for a correct robot, and allow a compromised one only a few times as much.

        Ordinary packets: 4 times the airtime of the robot's states. AUDIT packets: twice the airtime of one round,
        which has requests to 2 f_max + 1 auditors and 6 f_max replies; at least those requests, and two replies to
        each of n_max neighbours. A request contains the log of t_val, a checkpoint and overhead. Each packet takes
        `fixed_us`, and each byte its ns on top.

        Source: RoboRebound §3.8, §5.1; docs/spec/rebound-nodes.md.
        """
        auditors = 2 * config.f_max + 1
        state_us = fixed_us + STATE.size * ns_per_byte_broadcast / 1000
        log_bytes = config.t_val_ms / 1000 * config.log_bytes_per_s
        request_bytes = log_bytes + CHECKPOINT_BYTES + NEIGHBOUR_BYTES * config.n_max + REQUEST_OVERHEAD_BYTES
        fragments = -(-request_bytes // (config.packet_max_bytes - AUDIT_FRAGMENT.size))
        sent_bytes = request_bytes + fragments * AUDIT_FRAGMENT.size
        requests_us = auditors * (fragments * fixed_us + sent_bytes * ns_per_byte_unicast / 1000)
        reply_us = fixed_us + AUDIT_TOKEN.size * ns_per_byte_unicast / 1000
        audit_us = max(2 * (requests_us + 6 * config.f_max * reply_us), requests_us + 2 * config.n_max * reply_us)
        return cls(
            f_max=config.f_max,
            t_val_ms=config.t_val_ms,
            batch_size=config.batch_size,
            bucket_capacity=2 * auditors,
            bucket_period_ms=max(1, config.t_audit_ms // auditors),
            send_us_per_s=max(1, round(4 * state_us * 1000 / (config.t_control_ms * config.steps_per_state))),
            send_capacity_us=round(4 * state_us),
            audit_us_per_s=max(1, round(audit_us * 1000 / config.t_audit_ms)),
            audit_capacity_us=round(audit_us),
            airtime_fixed_us=fixed_us,
            airtime_ns_per_byte_broadcast=ns_per_byte_broadcast,
            airtime_ns_per_byte_unicast=ns_per_byte_unicast,
        )


def limits_of(config: BtiConfig, radio: RadioConfig) -> Limits:
    """Return the trusted nodes' limits on this radio. Source: docs/spec/rebound.md (audit flood)."""
    rates = rates_of(radio)
    per_kilobyte_us = unicast_us(rates, 2000) - unicast_us(rates, 1000)
    return Limits.of(config, int(broadcast_us(rates, 1)), math.ceil(8000 / radio.broadcast_mbps), int(per_kilobyte_us))


class MissionKey(NamedTuple):
    """The key that an operator loads into every node at the start of a mission. Source: RoboRebound §3.3."""

    k: bytes  # the mission key, blinded: the master key recovers it
    r: bytes
    seq: int
    mac: bytes


def seal_mission_key(master: bytes, mission: bytes, r: bytes, seq: int) -> MissionKey:
    """Return the mission key, blinded with a hash of the master key and authenticated under it.

    Seal each mission key only once. A robot that restarts and loads the same key again could reuse its old tokens,
    because its clock has restarted too.

    `master` and `mission` are K1 ‖ K2, `r` is random, and `seq` is higher than in any mission before.
    Raises: UsageError: a length or `seq` is wrong. Source: RoboRebound Alg. 2 (LoadMissionKey).
    """
    if not len(master) == len(mission) == len(r) == KEY_BYTES or seq < 1:
        raise UsageError(f"wrong length or seq: master key, mission key and r have {KEY_BYTES} bytes, seq >= 1")
    blind = np.zeros(HASH_BYTES, np.uint8)
    trusted.sha1(row(r + master), 2 * KEY_BYTES, blind)
    k = bytes(a ^ b for a, b in zip(mission, blind.tobytes(), strict=True))
    mac = np.zeros(MAC_BYTES, np.uint8)
    trusted.lightmac(row(master), row(MKEY.encode(k=k, r=r, seq=seq)), MKEY.size, mac)
    return MissionKey(k, r, seq, mac.tobytes())


class TrustedNodes(Protocol):
    """Trusted nodes of a list of robots, in this process or on other machines; robots are numbered from 0."""

    snode: NDArray[np.uint8]  # (n, size): the s-nodes, as kernels take them
    anode: NDArray[np.uint8]  # (n, size): the a-nodes

    def load_master(self, i: int, key: bytes, robot_id: int) -> None:
        """Load the master key and the id into both nodes of robot i, irrevocably."""
        ...

    def load_mission(self, i: int, now: int, sealed: MissionKey) -> None:
        """Load the mission key into both nodes of robot i."""
        ...


class Nodes:
    """The s- and a-nodes of n robots, without keys at first.

    `snode` and `anode` are their memory: (n, size) uint8, in whole cache lines. Robots are numbered from 0; their ids
    come with the master key. All have the same limits.
    Raises: UsageError: a limit is invalid.
    """

    def __init__(self, n: int, profile: int, limits: Limits) -> None:
        self.profile = profile
        self._ffi, self._lib = trusted.FIRMWARE[profile]
        self.snode = np.zeros((n, lines(self._lib.phx_snode_size())), np.uint8)
        self.anode = np.zeros((n, lines(self._lib.phx_anode_size())), np.uint8)
        try:
            made = self._ffi.new("phx_limits *", astuple(limits))
        except OverflowError as error:
            raise UsageError(f"a limit of the trusted nodes is out of range: {error}") from error
        for i in range(n):
            if self._lib.phx_snode_make(self._s(i), made) or self._lib.phx_anode_make(self._a(i), made):
                raise UsageError(
                    "the trusted nodes do not accept their limits",
                    "use an f_max of at most 15, and T_val, periods, rates and capacities above 0",
                )

    def _s(self, i: int) -> Any:
        return self._ffi.from_buffer("phx_snode *", self.snode[i])

    def _a(self, i: int) -> Any:
        return self._ffi.from_buffer("phx_anode *", self.anode[i])

    # --- calls of the operator, not of the c-node ------------------------------------------------------------------

    def load_master(self, i: int, key: bytes, robot_id: int) -> None:
        """Load the master key and the id into both nodes of robot i, irrevocably. Source: RoboRebound Alg. 2."""
        key = _exactly(key, KEY_BYTES)
        _checked(self._lib.phx_snode_load_master(self._s(i), key, robot_id))
        _checked(self._lib.phx_anode_load_master(self._a(i), key, robot_id))

    def load_mission(self, i: int, now: int, sealed: MissionKey) -> None:
        """Load the mission key into both nodes of robot i. Source: RoboRebound Alg. 2."""
        k, r, mac = _exactly(sealed.k, KEY_BYTES), _exactly(sealed.r, KEY_BYTES), _exactly(sealed.mac, MAC_BYTES)
        _checked(self._lib.phx_snode_load_mission(self._s(i), now, k, r, sealed.seq, mac))
        _checked(self._lib.phx_anode_load_mission(self._a(i), now, k, r, sealed.seq, mac))


def _exactly(raw: bytes, size: int) -> bytes:
    if len(raw) != size:
        raise Refused(trusted.E_ARG)
    return raw


def _checked(code: int) -> None:
    if code < 0:
        raise Refused(code)
