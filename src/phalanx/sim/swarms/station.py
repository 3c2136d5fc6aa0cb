"""The station that a gateway and its operator speak through, to robots that check who ordered what.

It says the gateway's beacon and the operator's stop to all, and visitors' orders each to its robot, all of it signed.
It speaks no faster than the channel and a robot's log have room for, whatever visitors do: of several orders of one
kind that wait for one robot only the newest is said.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.bti.audit import ENTRY_HEAD_BYTES
from phalanx.robot.signer import Signer
from phalanx.sim.audited import loop
from phalanx.sim.audited.world import World
from phalanx.sim.radio.channel import BROADCAST
from phalanx.wire.driven import GATEWAY, OPERATOR, SIGNER_KEY_BYTES

# A robot's log has room for so many bytes of orders a second, and for what all are told, which is as much as this many
# neighbours would say.
ORDERS_AS_NEIGHBOURS = 40
ORDER_BYTES_PER_S = 700
# All robots' together: a tenth of the channel.
ORDERS_PER_S = 330
BEACON_S = 1.0
# What all are told may be lost on the air: a stop, and its end, is said so often at once, and then with each beacon.
AT_ONCE, AGAIN_S = 5, 0.1
MOTION, COLOUR = 0, 1  # kinds of orders
# What makes an order's frame of the robot's id and the signer's clock, ms.
Make = Callable[[int, int], bytes]


class Station:
    """One radio that is no robot. Its keys come from `chance`: in a simulation they keep nothing secret.

    Attributes:
        held: whether the operator has all robots stand still; may be set by another thread.
    """

    def __init__(self, mission: int, chance: np.random.Generator) -> None:
        self.gateway, self.operator = (
            Signer(Ed25519PrivateKey.from_private_bytes(chance.bytes(SIGNER_KEY_BYTES)), mission, who)
            for who in (GATEWAY, OPERATOR)
        )
        self.held = False
        self._was_held = False
        self._at_once = 0
        self._beacon_at_s, self._operator_at_s = 0.0, np.inf
        self._may_speak_at_s = 0.0
        self._may_order_at_s: dict[int, float] = {}
        # By robot and kind, the longest waiting first.
        self._waiting: dict[tuple[int, int], Make] = {}
        self._told: dict[int, int] = {}

    def tell(self, robot: int, kind: int, make: Make) -> None:
        """An order for the robot of that row waits, in the place of one of its kind."""
        self._waiting[robot, kind] = make

    def told(self, robot: int) -> int | None:
        """The number of the last order to the robot; None if one to move is still to be said."""
        return None if (robot, MOTION) in self._waiting else self._told.get(robot, 0)

    def speak(self, world: World, robots: int, now_s: float) -> float:
        """What is due is in the radio, one frame at a time. Returns: when to ask again, s; never if nothing waits."""
        self._hear_operator(now_s)
        if now_s >= self._may_speak_at_s and not world.air.nic[robots].long_used:
            said_ms = int(world.clock[0].now_us) // 1000
            if not self._say_to_all(world, robots, now_s, said_ms):
                self._say_to_one(world, robots, now_s, said_ms)
        pace_s = 1 / ORDERS_PER_S if self._waiting or self._at_once else np.inf
        return now_s + pace_s

    def _hear_operator(self, now_s: float) -> None:
        held = self.held
        if held != self._was_held:
            self._was_held, self._at_once, self._operator_at_s = held, AT_ONCE, now_s
        if held:
            self._waiting = {key: make for key, make in self._waiting.items() if key[1] != MOTION}
            # What a long route has used up of a robot's log is made good when it stands.
            self._may_order_at_s.clear()

    def _say_to_all(self, world: World, station: int, now_s: float, said_ms: int) -> bool:
        if now_s >= self._operator_at_s:
            self._operator_at_s = now_s + (AGAIN_S if self._at_once else BEACON_S)
            self._at_once = max(0, self._at_once - 1)
            frame = self.operator.stop(said_ms) if self._was_held else self.operator.go(said_ms)
        elif now_s >= self._beacon_at_s:
            self._beacon_at_s = now_s + BEACON_S
            frame = self.gateway.beacon(said_ms)
        else:
            return False
        self._say(world, station, frame, BROADCAST, now_s)
        return True

    def _say_to_one(self, world: World, station: int, now_s: float, said_ms: int) -> None:
        for (i, kind), make in list(self._waiting.items()):
            if world.safe[i]:
                del self._waiting[i, kind]
            # Who has not heard yet that it may move would not obey.
            elif now_s >= self._may_order_at_s.get(i, 0.0) and not (kind == MOTION and self._at_once):
                del self._waiting[i, kind]
                frame = make(i + 1, said_ms)
                self._told[i] = self.gateway.number
                self._may_order_at_s[i] = now_s + (ENTRY_HEAD_BYTES + len(frame)) / ORDER_BYTES_PER_S
                self._say(world, station, frame, i, now_s)
                return

    def _say(self, world: World, station: int, frame: bytes, to: int, now_s: float) -> None:
        loop.transmit(world, station, np.frombuffer(bytearray(frame), np.uint8), len(frame), to)
        self._may_speak_at_s = now_s + 1 / ORDERS_PER_S
