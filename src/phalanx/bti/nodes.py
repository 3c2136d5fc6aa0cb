"""The trusted nodes of N robots, from the factory to Safe Mode, and the operator's side of their mission key.

`Nodes` owns their memory and has one method for each function of theirs, bytes in and bytes out, for tools, tests and a
single robot; kernels take `snode` and `anode` rows and call bti.trusted. Only this file makes nodes.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.config.bti import CHECKPOINT_BYTES, NEIGHBOUR_BYTES, REQUEST_OVERHEAD_BYTES
from phalanx.errors import PeerError, UsageError
from phalanx.wire.fields import Row
from phalanx.wire.table import (
    AUDIT_FRAGMENT,
    AUDIT_TOKEN,
    ENTRY_HEADER_BYTES,
    FRAME_MAX,
    HASH_BYTES,
    KEY_BYTES,
    MAC_BYTES,
    MKEY,
    STATE,
)

from . import trusted

REASONS = {code: name.removeprefix("E_").lower() for name, code in vars(trusted).items() if name.startswith("E_")}


class Refused(PeerError):
    """A trusted node refused what its c-node asked for; nothing has happened.

    Args:
        code: one of trusted.E_*; `reason` is its name in lower case.
    """

    reason = "refused"

    def __init__(self, code: int) -> None:
        super().__init__(f"a trusted node refused: {REASONS[code]}")
        self.code = code
        self.reason = REASONS[code]  # type: ignore[misc]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What a node is given at manufacture, in the order of phx_limits in firmware/include/phx.h.

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
        """The limits that leave an honest robot room and nobody more than a few times its needs.

        Ordinary frames: 4 times the airtime of its state broadcasts. AUDIT frames: twice that of a round's requests to
        2 f_max + 1 auditors, each the log of t_val with checkpoint and overhead, and of 6 f_max replies.

        Args:
            config: the audits' parameters.
            fixed_us: airtime of any frame, however short.
            ns_per_byte_broadcast: airtime of each byte, ns.
            ns_per_byte_unicast: the same where one robot is addressed.
        Source: RoboRebound §3.8, §5.1; docs/spec/rebound-nodes.md.
        """
        auditors = 2 * config.f_max + 1
        state_us = fixed_us + STATE.size * ns_per_byte_broadcast / 1000
        log_bytes = config.t_val_ms / 1000 * config.log_bytes_per_s
        request_bytes = log_bytes + CHECKPOINT_BYTES + NEIGHBOUR_BYTES * config.n_max + REQUEST_OVERHEAD_BYTES
        fragments = -(-request_bytes // (config.frame_max_bytes - AUDIT_FRAGMENT.size))
        sent_bytes = request_bytes + fragments * AUDIT_FRAGMENT.size
        requests_us = auditors * (fragments * fixed_us + sent_bytes * ns_per_byte_unicast / 1000)
        replies_us = 6 * config.f_max * (fixed_us + AUDIT_TOKEN.size * ns_per_byte_unicast / 1000)
        audit_us = 2 * (requests_us + replies_us)
        return cls(
            f_max=config.f_max,
            t_val_ms=config.t_val_ms,
            batch_size=config.batch_size,
            bucket_capacity=2 * auditors,
            bucket_period_ms=max(1, config.t_audit_ms // auditors),
            send_us_per_s=round(4 * state_us * 1000 / (config.t_control_ms * config.steps_per_state)),
            send_capacity_us=round(4 * state_us),
            audit_us_per_s=round(audit_us * 1000 / config.t_audit_ms),
            audit_capacity_us=round(audit_us),
            airtime_fixed_us=fixed_us,
            airtime_ns_per_byte_broadcast=ns_per_byte_broadcast,
            airtime_ns_per_byte_unicast=ns_per_byte_unicast,
        )


class MissionKey(NamedTuple):
    """What an operator hands to every node at the start of a mission. Source: RoboRebound §3.3."""

    k: bytes  # blinded: only who has the master key can tell the mission key
    r: bytes
    seq: int
    mac: bytes


def seal_mission_key(master: bytes, mission: bytes, r: bytes, seq: int) -> MissionKey:
    """The mission key, blinded with a hash of the master key and sealed under it.

    A key is for one mission and sealed once: a robot that restarts and gets the same key again could use its old tokens
    again, because its clock has begun anew.

    Args:
        master: 20 bytes, K1 ‖ K2.
        mission: 20 bytes, K1 ‖ K2.
        r: 20 random bytes.
        seq: higher than that of any mission before, at least 1.
    Raises: UsageError: a length or the number is wrong.
    Source: RoboRebound Alg. 2 (LoadMissionKey).
    """
    if not len(master) == len(mission) == len(r) == KEY_BYTES or seq < 1:
        raise UsageError(f"master key, mission key and r have {KEY_BYTES} bytes each, and seq is at least 1")
    blind = np.zeros(HASH_BYTES, np.uint8)
    trusted.sha1(_row(r + master), 2 * KEY_BYTES, blind)
    k = bytes(a ^ b for a, b in zip(mission, blind.tobytes(), strict=True))
    mac = np.zeros(MAC_BYTES, np.uint8)
    trusted.lightmac(_row(master), _row(MKEY.encode(k=k, r=r, seq=seq)), MKEY.size, mac)
    return MissionKey(k, r, seq, mac.tobytes())


class Nodes:
    """The s- and a-nodes of n robots, as they leave the factory; `snode` and `anode` are their memory, (n, size) uint8.

    Args:
        n: robots, known by their row from 0; their ids come with the master key.
        profile: trusted.BOUND or trusted.PAPER.
        limits: the same for all.
    Raises: UsageError: limits that make no sense.
    """

    def __init__(self, n: int, profile: int, limits: Limits) -> None:
        self.profile = profile
        self._ffi, self._lib = trusted.FIRMWARE[profile]
        self.snode = np.zeros((n, self._lib.phx_snode_size()), np.uint8)
        self.anode = np.zeros((n, self._lib.phx_anode_size()), np.uint8)
        try:
            made = self._ffi.new("phx_limits *", astuple(limits))
        except OverflowError as error:
            raise UsageError(f"limits of the trusted nodes: {error}") from error
        for i in range(n):
            if self._lib.phx_snode_make(self._s(i), made) or self._lib.phx_anode_make(self._a(i), made):
                raise UsageError("limits of the trusted nodes make no sense", "f_max at most 15; no zero periods")

    def _s(self, i: int) -> Any:
        return self._ffi.from_buffer("phx_snode *", self.snode[i])

    def _a(self, i: int) -> Any:
        return self._ffi.from_buffer("phx_anode *", self.anode[i])

    # --- from outside the c-node -----------------------------------------------------------------------------------

    def power_up(self, i: int) -> None:
        """Both nodes of robot i have lost what was in RAM. Source: RoboRebound §3.3."""
        self._lib.phx_snode_power_up(self._s(i))
        self._lib.phx_anode_power_up(self._a(i))

    def check_all(self, now_ms: NDArray[np.uint32]) -> NDArray[np.uint8]:
        """CheckTokens of every a-node.

        Args:
            now_ms: (n,), each robot's own clock.
        Returns: (n,), 1 for those in Safe Mode.
        Source: RoboRebound Alg. 4.
        """
        clocks = np.ascontiguousarray(now_ms, np.uint32)
        if clocks.shape != (len(self.anode),):
            raise UsageError(f"{clocks.shape} clocks for {len(self.anode)} robots")
        safe = np.zeros(len(self.anode), np.uint8)
        give = self._ffi.from_buffer
        self._lib.phx_anodes_check(
            give("phx_anode *", self.anode), len(safe), give("uint32_t *", clocks), give("uint8_t *", safe)
        )
        return safe

    def is_safe(self, i: int) -> bool:
        """Whether robot i is in Safe Mode. Source: RoboRebound §3.1."""
        return bool(self._lib.phx_anode_is_safe(self._a(i)))

    # --- what a c-node can call; each raises Refused ---------------------------------------------------------------

    def load_master(self, i: int, key: bytes, robot_id: int) -> None:
        """Both nodes of robot i have their master key, for ever. Source: RoboRebound Alg. 2."""
        for load, node in (
            (self._lib.phx_snode_load_master, self._s(i)),
            (self._lib.phx_anode_load_master, self._a(i)),
        ):
            _checked(load(node, _exactly(key, KEY_BYTES), robot_id))

    def load_mission(self, i: int, now: int, sealed: MissionKey) -> None:
        """Both nodes of robot i have the mission key. Source: RoboRebound Alg. 2."""
        k, r, mac = _exactly(sealed.k, KEY_BYTES), _exactly(sealed.r, KEY_BYTES), _exactly(sealed.mac, MAC_BYTES)
        for load, node in (
            (self._lib.phx_snode_load_mission, self._s(i)),
            (self._lib.phx_anode_load_mission, self._a(i)),
        ):
            _checked(load(node, now, k, r, sealed.seq, mac))

    def poll(self, i: int, now: int, reading: bytes) -> bytes:
        """The entry of a sensor reading, chained. Source: RoboRebound Alg. 3."""
        return self._forward(trusted.snode_poll, self.snode[i], now, reading)

    def recv(self, i: int, now: int, frame: bytes) -> bytes:
        """The entry of a frame from the radio. Source: RoboRebound Alg. 4."""
        return self._forward(trusted.anode_recv, self.anode[i], now, frame)

    def send(self, i: int, now: int, frame: bytes) -> bytes:
        """The entry of a frame to the radio; on air goes what is behind its header. Source: RoboRebound Alg. 4."""
        return self._forward(trusted.anode_send, self.anode[i], now, frame)

    def actuate(self, i: int, now: int, command: bytes) -> bytes:
        """The entry of a command to the actuators. Source: RoboRebound Alg. 4."""
        return self._forward(trusted.anode_actuate, self.anode[i], now, command)

    def _forward(self, function: Any, node: Row, now: int, payload: bytes) -> bytes:
        entry = np.zeros(ENTRY_HEADER_BYTES + min(len(payload), FRAME_MAX), np.uint8)
        return bytes(entry[: _checked(function(self.profile, node, now, _row(payload), len(payload), entry))])

    def make_auth(self, i: int, nonce: bytes) -> bytes:
        """The record `authenticator` of the s-chain. Source: RoboRebound Alg. 2."""
        out = np.zeros(trusted.AUTH_BYTES, np.uint8)
        _checked(trusted.snode_make_auth(self.profile, self.snode[i], _row(nonce), out))
        return out.tobytes()

    def check_auth(self, i: int, top: bytes, robot_id: int, nonce: bytes, mac: bytes) -> None:
        """Robot i's s-node knows the authenticator for good. Source: RoboRebound Alg. 3."""
        rows = _row(top), robot_id, _row(nonce), _row(mac)
        _checked(trusted.snode_check_auth(self.profile, self.snode[i], *rows))

    def make_auth_a(self, i: int) -> bytes:
        """`paper` only: the record `authenticator` of the a-chain. Source: RoboRebound Alg. 2."""
        out = np.zeros(trusted.AUTH_BYTES, np.uint8)
        _checked(trusted.anode_make_auth(self.profile, self.anode[i], out))
        return out.tobytes()

    def check_auth_a(self, i: int, top: bytes, robot_id: int, mac: bytes) -> None:
        """`paper` only: robot i's s-node knows an a-node's authenticator for good. Source: RoboRebound Alg. 3."""
        _checked(trusted.snode_check_auth_a(self.profile, self.snode[i], _row(top), robot_id, _row(mac)))

    def token_request(self, i: int, now: int, tor: int) -> bytes:
        """The record `token_request`. Source: RoboRebound Alg. 4."""
        out = np.zeros(trusted.TREQ_BYTES, np.uint8)
        _checked(trusted.anode_token_request(self.profile, self.anode[i], now, tor, out))
        return out.tobytes()

    def issue_token(self, i: int, tee: int, t: int, top: bytes, treq_mac: bytes, hckpt: bytes) -> bytes:
        """The MAC of robot i's token for `tee`. Source: RoboRebound Alg. 4."""
        mac = np.zeros(MAC_BYTES, np.uint8)
        rows = _row(top), _row(treq_mac), _row(hckpt), mac
        _checked(trusted.anode_issue_token(self.profile, self.anode[i], tee, t, *rows))
        return mac.tobytes()

    def check_token(self, i: int, tor: int, tee: int, t: int, hckpt: bytes, mac: bytes) -> None:
        """Robot i's a-node knows the token for good. Source: RoboRebound Alg. 4."""
        _checked(trusted.anode_check_token(self.profile, self.anode[i], tor, tee, t, _row(hckpt), _row(mac)))

    def install_token(self, i: int, now: int, tor: int, t: int, hckpt: bytes, mac: bytes) -> None:
        """Robot i's a-node counts the token. Source: RoboRebound Alg. 4."""
        _checked(trusted.anode_install_token(self.profile, self.anode[i], now, tor, t, _row(hckpt), _row(mac)))


def _row(raw: bytes) -> Row:
    return np.frombuffer(bytearray(raw), np.uint8)  # writable: one type for the kernels


def _exactly(raw: bytes, size: int) -> bytes:
    if len(raw) != size:
        raise Refused(trusted.E_ARG)
    return raw


def _checked(code: int) -> int:
    if code < 0:
        raise Refused(code)
    return code
