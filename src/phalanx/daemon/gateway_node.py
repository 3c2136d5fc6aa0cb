"""Trusted nodes of a gateway's own: they seal what it says to robots, and check the tokens that it hears.

They are a robot's nodes, under a number of their own among the mission's keys, with limits that stop nobody: no robot
audits a gateway. Whoever has them can seal packets and vouch, as any one robot can. Source: docs/adr/0034.
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
# Nobody vouches for a gateway: its nodes ask for no tokens for as long as their clock counts, 49 days.
T_VAL_MS = 0xFFFFFFFF
# Its station speaks at a pace of its own.
ALL_US = 1_000_000
# A process begins its clock anew at each start, and robots take no seal that is older than one before. So its clock
# begins where none of its seals can have been: a file says up to where it may have sealed, and is ahead by so much.
RESERVED_MS = 3_600_000
LAST_MS = 1 << 31  # of what a process's clock begins with
DRIFT = 2000  # of two clocks, the one may gain a part in so many on the other: 500 ppm
CLAIMS = 4  # checkpoints of a robot that a token may be for, the newest


class GatewayNode:
    """Holds nodes with the mission's key until `close`; `clock_file` keeps up to where a process may have sealed.

    Raises: UsageError: a file, or the nodes, are another's; Unavailable: nobody answers, or they have had the key.
    """

    def __init__(self, settings: RobotSettings, scenario: Scenario, clock_file: Path) -> None:
        said = settings.said
        self._is_sealed, self._file = said.radio.sealed, clock_file
        self._is_process = said.trusted.startswith("process:")
        self._reserved_ms = 0
        if self._is_process:
            self._reserved_ms = _kept(clock_file)
            settings = replace(settings, said=replace(said, clock_ahead_ms=self._reserved_ms))
            # It is made anew: a process has its key as long as it lives, and takes no mission's twice.
            flash = settings.path(said.trusted.partition(":")[2])
            if flash.exists():
                # A key's file, or a robot's nodes, named by mistake, must not go.
                before = connect_nodes(settings)
                before.close()
                if before.about.robot_id != said.robot:
                    raise UsageError(
                        f"{flash} holds no nodes of this gateway's", "the name of a file that is not there"
                    )
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
            return  # a board that kept its power: the gateway alone was started again
        start(self._node, provision_keys(self._node, settings, gateway_limits(scenario)))
        self._reserve(self._reserved_ms)

    def seal(self, packet: bytes) -> bytes:
        """The packet as it goes out; b"" if it is too much at once. Raises: Unavailable: they are gone, or refuse."""
        if not self._is_sealed:
            return packet
        code, result = self._node.ask(lines.SEND, packet=packet)
        if code == E_AIRTIME:
            return b""
        if code < 0:
            raise Unavailable(f"the gateway's trusted nodes seal nothing: {REASONS[code]}", "the next mission's key")
        self._reserve(get_u32(row(result), AT_T))
        return result[ENTRY_HEADER_BYTES:]

    def open(self, raw: bytes) -> bytes:
        """The packet in what came; b"" if robots' nodes would not take it. Raises: Unavailable: ours are gone."""
        if not self._is_sealed:
            return raw
        if len(raw) <= SEAL.size or self._node.ask(lines.RECV, packet=raw)[0] < 0:
            return b""
        return raw[: -SEAL.size]

    def store_fragment(self, packet: bytes) -> None:
        """A piece of a request: its first one says which checkpoint tokens will be for."""
        with contextlib.suppress(PeerError):
            said = AUDIT_FRAGMENT.decode(packet)
            hckpt = said["bytes"][AT_HCKPT : AT_HCKPT + HASH_BYTES]
            if said["index"] == 0 and len(hckpt) == HASH_BYTES and hckpt not in self._claims[said["src"]]:
                self._claims[said["src"]].append(hckpt)

    def is_token(self, auditor: int, auditee: int, t: int, mac: bytes) -> bool:
        """Return whether the auditor's nodes made this token, for a checkpoint that the auditee showed."""
        return any(
            self._node.ask(lines.CHECK_TOKEN, auditor=auditor, auditee=auditee, t=t, hckpt=hckpt, mac=mac)[0] >= 0
            for hckpt in reversed(self._claims[auditee])
        )

    def age_s(self, auditee: int, t: int, now_s: float) -> float:
        """How old a true token is that a robot asked for at `t` of its clock.

        That clock is where the least `now - t` of all true tokens for it says; of the same time a part in DRIFT more.
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
        """Nobody asks them any more."""
        self._node.close()


def gateway_limits(scenario: Scenario) -> Limits:
    """Return the limits with which a gateway's nodes are made."""
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
        raise UsageError(f"{path} says {kept} ms", "the mission is old: issue the next one's key")
    return kept
