"""Robots in separate processes as an `AuditedSwarm`: the gateway's radio among theirs.

It sends them signed orders, and receives their states and the tokens that they exchange. If the gateway has trusted
nodes, only tokens that they verified are shown. Robots' places are unverified claims.
"""

from __future__ import annotations

import logging
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.errors import PeerError, Unavailable, Unknown
from phalanx.net.private_file import write_private
from phalanx.net.udp_radio import Address, UdpRadio, parse_address
from phalanx.robot import Led, Point, Robot
from phalanx.robot.roster import HISTORY_STEP_MM, member
from phalanx.robot.station import Ordered, Station
from phalanx.robot.swarm import AttackChoice, Audit, Shield
from phalanx.wire.driven import EVERYBODY, GATEWAY, OPERATOR
from phalanx.wire.table import (
    AUDIT_FRAGMENT,
    AUDIT_TOKEN,
    FRAGMENT,
    KIND_AUDIT,
    KIND_WHEELS_STATE,
    TOKEN_REPLY,
    WHEELS_STATE,
)

from .gateway_node import GatewayNode
from .sealed_air import may_send
from .swarm_file import SwarmSettings

log = logging.getLogger(__name__)

TURN_S = 0.02
# On exit, robots on a route are stopped this many times, as UDP loses packets, within this time.
LAST_TIMES, LAST_ORDERS_S = 3, 3.0
# A robot counts as silent after missing this many states.
SILENT_STATES = 4
# Orders of each start are dated a year after the previous start's, so they are newer whatever the clock (orders.md).
YEAR_MS = 365 * 86_400_000
LATEST_MS = 1 << 63
SUB = AUDIT_TOKEN.at("sub")


class RobotSwarm(Ordered):
    """The robots in a swarm's file, while the context lasts; on exit moving robots are stopped.

    A robot is listed once its first state is received. A token counts from when it was requested, as far as known;
    `unchecked` has the reason if no tokens are shown. The clock returns seconds since 1970.
    Raises: UsageError: the mission names other keys; Unavailable: radio, nodes or its file do not work.
    """

    def __init__(
        self,
        settings: SwarmSettings,
        gateway: Ed25519PrivateKey,
        operator: Ed25519PrivateKey,
        clock: Callable[[], float] = time.time,
    ) -> None:
        said = sorted(settings.said.robots, key=lambda each: each.robot)
        ids = [each.robot for each in said]
        station = Station(settings.signer(gateway, GATEWAY), settings.signer(operator, OPERATOR))
        super().__init__((member(rob_id - 1) for rob_id in ids), ids, station)
        self._settings, self._clock = settings, clock
        self._at: dict[int, Address] = {each.robot: parse_address(each.at) for each in said}
        self._peers = list(dict.fromkeys(each.at for each in said))  # in an arena all have one
        self._places: dict[int, tuple[Point, int]] = {}
        self._heard_at_s: dict[int, float] = {}
        self._first_at_s: dict[int, float] = {}
        self._tokens: dict[tuple[int, int], float] = {}
        self._newest_ms: dict[tuple[int, int], int] = {}
        self._node: GatewayNode | None = None
        self.unchecked = "" if settings.own else "the gateway has no trusted nodes: pages show no shields"
        self._audits: deque[Audit] = deque(maxlen=1000)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, name="robots", daemon=True)

    def __enter__(self) -> Self:
        first_ms = self._reserve()
        for signer in (self._station.gateway, self._station.operator):
            signer.number = first_ms
        # This clock also counts while the machine is suspended, so orders stay newer.
        self._ahead_s = first_ms / 1000 - time.clock_gettime(time.CLOCK_BOOTTIME)
        may = may_send(self._settings.scenario, len(self._peers))
        self._radio = UdpRadio(self._settings.said.here, self._peers, may=may)
        if own := self._settings.own:
            try:
                self._node = GatewayNode(own, self._settings.scenario, self._beside("clock"))
            except BaseException:
                self._radio.close()
                raise
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join(LAST_ORDERS_S + 1)
        self._radio.close()
        if self._node:
            self._node.close()

    def _beside(self, what: str) -> Path:
        """Return the path of a file of this mission beside the gateway's own file."""
        return self._settings.path.with_name(f"mission-{self._settings.mission}.{what}")

    def _reserve(self) -> int:
        """Return the time of this start's first order, ms: later than all orders of earlier starts."""
        mission, now_ms = self._settings.mission, int(self._clock() * 1000)
        path = self._beside("said")
        try:
            before_ms = int(path.read_text())
            if not 0 <= before_ms < LATEST_MS:  # later times must fit an order
                raise ValueError(before_ms)
            first_ms = max(now_ms, before_ms + YEAR_MS)
        except FileNotFoundError:
            first_ms = now_ms
            log.warning(
                "mission %d is new here: %s is created. If another gateway, or a copy of this folder, drove robots in "
                "this mission, they ignore all orders from here, also stops: then issue the next mission's key",
                mission,
                path,
            )
        except (OSError, ValueError) as error:
            raise Unavailable(f"cannot read {path}", "remove it, and issue the next mission's key") from error
        write_private(path, b"%d\n" % first_ms, replace=True)
        return first_ms

    # --- its thread ---------------------------------------------------------------------------------------------------

    def _live(self) -> None:
        until_s, times, under_way, trouble = float("inf"), LAST_TIMES, list[str](), ""
        while (now_s := time.monotonic()) < until_s and (times or self._station.has_pending_order):
            try:
                next_s = self._station.send_due(self, now_s, self._order_time_ms)
                self._listen(min(max(0.0, next_s - now_s), TURN_S))
            except Unavailable as error:  # its nodes are gone, and robots accept only sealed packets
                if str(error) != trouble:
                    log.warning("%s", error)
                trouble = str(error)
                time.sleep(TURN_S)
            except Exception:  # stops have still to be sent
                log.exception("the robots' radio failed")
                time.sleep(TURN_S)
            if not self._over.is_set():
                continue
            if until_s > now_s + LAST_ORDERS_S:
                until_s = now_s + LAST_ORDERS_S
                under_way = [each.address for each in self._members if each.route]
                self._station.drop_pending()
            elif not times or self._station.has_pending_order:
                continue
            times -= 1
            for address in under_way:
                self.stop(address)

    @property
    def _order_time_ms(self) -> int:
        return int((time.clock_gettime(time.CLOCK_BOOTTIME) + self._ahead_s) * 1000)

    def is_busy(self) -> bool:
        """See `phalanx.robot.station.Air`."""
        return False

    def is_permanently_stopped(self, robot: int) -> bool:
        """See `phalanx.robot.station.Air`: a robot's claims are no proof."""
        return robot not in self._at

    def say(self, packet: bytes, robot: int) -> None:
        """See `phalanx.robot.station.Air`."""
        if self._node and not (packet := self._node.seal(packet)):
            return
        if robot == EVERYBODY:
            self._radio.send(packet)
        else:
            self._radio.send_to(packet, self._at[robot])

    def _listen(self, wait_s: float) -> None:
        """Handle one packet, each sender in turn: boards need long for some packets, and a stop may wait."""
        if packet := self._radio.take():
            self._on_packet(packet)
        else:
            select.select([self._radio], [], [], wait_s)

    def _on_packet(self, packet: bytes) -> None:
        if self._node and not (packet := self._node.open(packet)):
            return
        try:
            if packet[0] == KIND_WHEELS_STATE:
                self._on_state(WHEELS_STATE.decode(packet))
            elif self._node and packet[0] == KIND_AUDIT and len(packet) > SUB:
                if packet[SUB] == FRAGMENT and self._is_from(AUDIT_FRAGMENT.decode(packet)["src"]):
                    self._node.store_fragment(packet)
                elif packet[SUB] == TOKEN_REPLY:
                    self._on_token(self._node, AUDIT_TOKEN.decode(packet))
        except PeerError:
            log.debug("a malformed packet")

    def _is_from(self, robot: int) -> bool:
        return self._at.get(robot) == self._radio.came_from

    def _on_state(self, state: dict[str, Any]) -> None:
        robot = state["id"]
        if not self._is_from(robot):
            return
        i = self._ids.index(robot)
        # Clipped, as a compromised robot can claim any place and pages show only the area.
        width_mm, height_mm = self.area_mm
        x_mm, y_mm = min(max(state["x_mm"], 0.0), width_mm), min(max(state["y_mm"], 0.0), height_mm)
        self._places[robot] = Point(x_mm, y_mm), round(state["direction_deg"])
        self._heard_at_s[robot] = self._clock()
        self._first_at_s.setdefault(robot, time.monotonic())
        each = self._members[i]
        each.led = Led(state["red"], state["green"], state["blue"])
        each.append_position(x_mm, y_mm, HISTORY_STEP_MM)
        if each.route:
            last = each.route[-1]
            if (last.x_mm - x_mm) ** 2 + (last.y_mm - y_mm) ** 2 <= each.threshold_mm**2:
                each.route = ()

    def _on_token(self, node: GatewayNode, token: dict[str, Any]) -> None:
        auditor, auditee, t = token["src"], token["dst"], token["t"]
        if (
            not self._is_from(auditor)
            or auditee not in self._at
            or auditor == auditee
            or t <= self._newest_ms.get((auditor, auditee), 0)
        ):
            return
        try:
            is_true = node.is_token(auditor, auditee, t, token["mac"])
        except Unavailable as error:
            if not self.unchecked:
                log.warning("%s", error)
            self.unchecked = "the gateway's trusted nodes are gone: pages show no shields"
            return
        if is_true:
            self._newest_ms[auditor, auditee] = t
            now_s = time.monotonic()
            # With its true age: delayed tokens must not make a robot look protected for longer.
            self._tokens[auditor, auditee] = now_s - node.age_s(auditee, t, now_s)
            self._audits.append(Audit(auditor=self._address(auditor), auditee=self._address(auditee), refusal=""))

    # --- the swarm ----------------------------------------------------------------------------------------------------

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return width and height of the mission's area."""
        width_m, height_m = self._settings.scenario.area_m
        return round(1000 * width_m), round(1000 * height_m)

    def robots(self) -> Sequence[Robot]:
        """Return every robot heard so far, at its claimed place. Robots do not report batteries."""
        return [
            each.snapshot(*self._places[robot], 0.0, self._heard_at_s[robot])
            for robot, each in zip(self._ids, self._members, strict=True)
            if robot in self._heard_at_s
        ]

    def stop(self, address: str) -> None:
        """Stop a robot until the next command."""
        self.drive(address, 0, 0)

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Visit these points in order; none stops the robot. Raises: UsageError: more than `longest_route`."""
        i = self._find(address)
        self._follow(i, route, threshold_mm, self._places[self._ids[i]][0])

    def _find(self, address: str) -> int:
        i = super()._find(address)
        if self._ids[i] not in self._places:
            raise Unknown("this robot has not been heard yet")
        return i

    def _address(self, robot: int) -> str:
        return self._members[self._ids.index(robot)].address

    # --- the shields --------------------------------------------------------------------------------------------------

    def shields(self) -> Sequence[Shield]:
        """Return one for every robot heard so far; none if tokens are not checked."""
        if self.unchecked:
            return ()
        now_s = time.monotonic()
        return [self._shield(robot, now_s) for robot in self._ids if robot in self._heard_at_s]

    def _shield(self, robot: int, now_s: float) -> Shield:
        bti = self._settings.scenario.bti
        full_s = bti.t_val_ms / 1000
        left = sorted(((left_s, auditor) for auditor, left_s in self._vouchers(robot, full_s, now_s)), reverse=True)
        silent_s = SILENT_STATES * bti.steps_per_state * bti.t_control_ms / 1000
        is_silent = self._clock() - self._heard_at_s[robot] > silent_s
        # A token missed only by the gateway stops no robot: by then there is a newer one.
        longer_s = full_s + bti.t_audit_ms / 1000
        doubted = now_s - self._first_at_s[robot] > longer_s and (
            sum(1 for _ in self._vouchers(robot, longer_s, now_s)) < bti.tokens_needed
        )
        return Shield(
            address=self._address(robot),
            needed=bti.tokens_needed,
            full_s=full_s,
            vouchers=tuple((self._address(auditor), left_s) for left_s, auditor in left),
            safe_mode=doubted or (is_silent and len(left) < bti.tokens_needed),
            attack="",
        )

    def _vouchers(self, robot: int, good_s: float, now_s: float) -> Iterator[tuple[int, float]]:
        for auditor in self._ids:
            left_s = self._tokens.get((auditor, robot), -good_s) + good_s - now_s
            if left_s > 0:
                yield auditor, left_s

    def new_audits(self) -> Sequence[Audit]:
        """Return audits that ended with a token since the last call, oldest first; refusals are not sent."""
        return [self._audits.popleft() for _ in range(len(self._audits))]

    def attacks(self) -> Sequence[AttackChoice]:
        """Return no attacks: real robots cannot be compromised from the page."""
        return ()

    def compromise(self, address: str, attack: str) -> None:
        """Refuse. Raises: Unknown: no such attack."""
        raise Unknown(f"no attack {attack[:64]!r} of {address[:64]!r}")
