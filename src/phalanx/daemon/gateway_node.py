"""A gateway's own trusted nodes: they seal its packets to robots, and check the tokens that it receives.

They are a robot's nodes with an id of their own among the mission's keys, and without limits, as no robot audits a
gateway. Like any robot, their holder can seal packets and issue tokens. Source: docs/adr/0034.
"""

from __future__ import annotations

import contextlib
from collections import defaultdict, deque
from dataclasses import replace
from pathlib import Path

from phalanx.bti.nodes import Limits, limits_of
from phalanx.bti.trusted import E_AIRTIME, REASONS
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.net.mission_key import read_mission_key
from phalanx.net.private_file import write_private
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import lines
from phalanx.wire.fields import get_u32, row
from phalanx.wire.table import AUDIT_FRAGMENT, ENTRY_HEADER_BYTES, HASH_BYTES, REQUEST, SEAL

from .settings import RobotSettings
from .trusted import AT_T, WHAT_TIME, connect_nodes, provision_keys, start

AT_HCKPT = REQUEST.at("hckpt")
# A gateway gets no tokens: its nodes do not require any as long as their clock counts, 49 days.
T_VAL_MS = 0xFFFFFFFF
# The gateway's station limits its own rate.
ALL_US = 1_000_000
# A process restarts its clock at each start, and robots reject seals older than previous ones. So its clock starts
# later than any seal before: a file contains a reserved time, at most RESERVED_MS ahead of the seals.
RESERVED_MS = 3_600_000
LAST_MS = 1 << 31  # largest start value of a process's clock
DRIFT = 2000  # clocks may drift apart by 1 / DRIFT: 500 ppm
CLAIMS = 4  # newest checkpoints of a robot for which a token is accepted


class GatewayNode:
    """Owns nodes with the mission key until `close`; `clock_file` stores the reserved time of a process.

    Raises: UsageError: a file or the nodes belong to others; Unavailable: no answer, or the key was loaded before.
    """

    def __init__(self, settings: RobotSettings, scenario: Scenario, clock_file: Path) -> None:
        said = settings.said
        self._is_sealed, self._file = said.radio.sealed, clock_file
        self._is_process = said.trusted.startswith("process:")
        self._reserved_ms = 0
        if self._is_process:
            self._reserved_ms = _kept(clock_file)
            settings = replace(settings, said=replace(said, clock_ahead_ms=self._reserved_ms))
            # The nodes are created anew: a process loses its key when it ends, and loads each mission's only once.
            flash = settings.path(said.trusted.partition(":")[2])
            if flash.exists():
                # A key file or a robot's nodes, named by mistake, must not be deleted.
                before = connect_nodes(settings)
                before.close()
                if before.about.robot_id != said.robot:
                    raise UsageError(f"{flash} does not belong to this gateway's nodes", "use the name of a new file")
                flash.unlink()
        self._node = connect_nodes(settings)
        try:
            self._begin(settings, scenario)
        except BaseException:
            self._node.close()
            raise
        self._least_s: dict[int, tuple[float, float]] = {}
        self._claims: defaultdict[int, deque[bytes]] = defaultdict(lambda: deque(maxlen=CLAIMS))

    def _begin(self, settings: RobotSettings, scenario: Scenario) -> None:
        sealed = read_mission_key(settings.path(settings.said.key), settings.said.robot)
        if self._node.about.seq == sealed.seq and self._node.ask(lines.SEND, packet=WHAT_TIME)[0] > 0:
            return  # a board that kept its power while the gateway was restarted
        start(self._node, provision_keys(self._node, settings, gateway_limits(scenario)))
        self._reserve(self._reserved_ms)

    def seal(self, packet: bytes) -> bytes:
        """Return the sealed packet, or b"" above the rate limit. Raises: Unavailable: the nodes are gone, or refuse."""
        if not self._is_sealed:
            return packet
        code, result = self._node.ask(lines.SEND, packet=packet)
        if code == E_AIRTIME:
            return b""
        if code < 0:
            raise Unavailable(f"the gateway's trusted nodes do not seal: {REASONS[code]}", "issue the next key")
        self._reserve(get_u32(row(result), AT_T))
        return result[ENTRY_HEADER_BYTES:]

    def open(self, raw: bytes) -> bytes:
        """Return the packet without its seal, or b"" if the seal is invalid. Raises: Unavailable: nodes are gone."""
        if not self._is_sealed:
            return raw
        if len(raw) <= SEAL.size or self._node.ask(lines.RECV, packet=raw)[0] < 0:
            return b""
        return raw[: -SEAL.size]

    def store_fragment(self, packet: bytes) -> None:
        """Store the checkpoint of an audit request from its first fragment: tokens will refer to it."""
        with contextlib.suppress(PeerError):
            said = AUDIT_FRAGMENT.decode(packet)
            hckpt = said["bytes"][AT_HCKPT : AT_HCKPT + HASH_BYTES]
            if said["index"] == 0 and len(hckpt) == HASH_BYTES and hckpt not in self._claims[said["src"]]:
                self._claims[said["src"]].append(hckpt)

    def is_token(self, auditor: int, auditee: int, t: int, mac: bytes) -> bool:
        """Return whether the auditor's nodes issued this token, for a checkpoint that the auditee sent."""
        return any(
            self._node.ask(lines.CHECK_TOKEN, auditor=auditor, auditee=auditee, t=t, hckpt=hckpt, mac=mac)[0] >= 0
            for hckpt in reversed(self._claims[auditee])
        )

    def age_s(self, auditee: int, t: int, now_s: float) -> float:
        """Return the age of a genuine token that a robot requested at `t` of its own clock.

        The robot's clock is estimated from the least `now - t` of all its genuine tokens, plus a drift of 1 / DRIFT.
        """
        behind_s = now_s - t / 1000
        least_s, since_s = self._least_s.get(auditee, (behind_s, now_s))
        age_s = behind_s - least_s - (now_s - since_s) / DRIFT
        if age_s <= 0:
            self._least_s[auditee] = behind_s, now_s
        return max(0.0, age_s)

    def _reserve(self, now_ms: int) -> None:
        if self._is_process and now_ms + RESERVED_MS // 2 >= self._reserved_ms:
            self._reserved_ms = now_ms + RESERVED_MS
            write_private(self._file, b"%d\n" % self._reserved_ms, replace=True)

    def close(self) -> None:
        """Disconnect from the nodes."""
        self._node.close()


def gateway_limits(scenario: Scenario) -> Limits:
    """Return the limits of a gateway's nodes."""
    limits = limits_of(scenario.bti, scenario.radio)
    return replace(limits, t_val_ms=T_VAL_MS, send_us_per_s=ALL_US, send_capacity_us=ALL_US)


def _kept(path: Path) -> int:
    try:
        kept = int(path.read_text())
    except FileNotFoundError:
        return 0
    except (OSError, ValueError) as error:
        raise Unavailable(f"cannot read {path}", "remove it, and issue the next mission's key") from error
    if not 0 <= kept < LAST_MS:
        raise UsageError(f"{path} contains {kept} ms, which is out of range", "issue the next mission's key")
    return kept
