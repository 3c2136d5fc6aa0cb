"""False claims: identity, position, actions in other protocols, and orders in the gateway's name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.bti.fleet import PLAIN
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.adversary.attack import Scene
from phalanx.robot.adversary.liar import Liar, Motion
from phalanx.robot.controllers.peer_bodies import fields_of
from phalanx.robot.controllers.peers import PeerController
from phalanx.robot.controllers.places import PLACES, PlaceController
from phalanx.robot.controllers.python_controller import Act, Send
from phalanx.wire import driven
from phalanx.wire.driven import GATEWAY, ORDER, SIGNATURE_BYTES, SIGNER_KEY_BYTES, TELL_STOP, TELL_WHEELS
from phalanx.wire.protocols import CLAIM, KIND_CLAIM, KIND_SIGHTING, NOWHERE, SIGHTING

from .hijack import OmitSends

# Each victim gets a false state in each control period: the adversary broadcasts "faster than correct c-nodes".
# Compromised robots may share the victims: ten of them at full rate fill the channel by themselves.
LIES_PERIOD_S = 0.25
LIES_MPS, TOLD_APART_MPS = 1.0, 1e-6
INVENTED = 60_000  # no robot has an id from here on
MOST = 2**63 - 1  # the highest number that a robot accepts


def spoofed_state(
    victim_pos: tuple[float, float], goal: tuple[float, float], z: float = 150.0, eps: float = 2.0
) -> tuple[float, float, float, float]:
    """Return the position (m) and velocity (m/s) to claim for another robot: in the victim's way.

    Nearer than z: 1 m from the victim, towards the goal. Farther: z - eps from the goal, on the victim's way. In both
    cases moving away from the goal at 1 m/s. The paper calls z the maximum distance kept between victim and goal, but
    in its formula z is the minimum. The paper prints the velocity as a second x_spoof. All lengths are in m.
    Source: RoboRebound §5.3.
    """
    dx, dy = victim_pos[0] - goal[0], victim_pos[1] - goal[1]
    distance = math.hypot(dx, dy)
    # A victim at the goal has no direction to it: any direction will do.
    ux, uy = (dx / distance, dy / distance) if distance > 0.0 else (1.0, 0.0)
    if distance <= z:
        return victim_pos[0] - ux, victim_pos[1] - uy, ux, uy
    return goal[0] + (z - eps) * ux, goal[1] + (z - eps) * uy, ux, uy


class Spoof(Liar):
    """Claim, in the name of a random other robot, to be in the way of one victim after the other.

    Each victim gets a false state every `every` seconds. `strong=1` needs a robot without a defence, where no a-node
    turns packets into broadcasts: it claims to each victim alone that every other robot is in its way.
    Source: RoboRebound §5.3; the choice of the name is ours (docs/spec/rebound.md).
    """

    period_ms = 10
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._period_ms = max(1, round(1000 * float(self.plan.options.get("every", LIES_PERIOD_S))))
        self._strong = bool(self.plan.options.get("strong")) and self.profile == PLAIN

    def on_state_received(self, rob_id: int, motion: Motion) -> None:
        """Note a state, unless its speed shows that a colluding robot made it up."""
        if not (self.plan.colluding and abs(math.hypot(motion.vx_mps, motion.vy_mps) - LIES_MPS) < TOLD_APART_MPS):
            super().on_state_received(rob_id, motion)

    def on_wake(self, now_ms: int) -> list[Action]:
        victims = sorted(self.seen)
        due = (now_ms - self.plan.start_ms) * len(victims) // self._period_ms
        self._turn = max(self._turn, due - len(victims))
        actions: list[Action] = []
        while self._turn < due:
            victim = victims[self._turn % len(victims)]
            self._turn += 1
            names = [rob_id for rob_id in self.others() if rob_id != victim]
            if names and not self._strong:
                names = [names[int(self.plan.chance.integers(len(names)))]]
            for name in names:
                lie = _in_the_way(self, self.seen[victim])
                actions += self.claim_motion(now_ms, name, lie, victim if self._strong else EVERYBODY)
        return actions


class Masquerade(OmitSends):
    """Impersonate another robot: broadcast only states with its id, in the nearest victim's way.

    Source: RoboRebound §2.4, Fig. 2.
    """

    period_ms = 250

    def on_wake(self, now_ms: int) -> list[Action]:
        if len(self.seen) < 2:
            return []
        mask = min(self.seen)
        return self.claim_motion(now_ms, mask, _in_the_way(self, self.nearest(but=mask)))


class FalseState(Masquerade):
    """Claim to be in the nearest robot's way."""

    def on_wake(self, now_ms: int) -> list[Action]:
        return self.claim_motion(now_ms, self.id, _in_the_way(self, self.nearest())) if self.seen else []


class Equivocate(Masquerade):
    """Claim a different own state to each victim: by unicast without a defence, else by broadcast in turn."""

    def on_wake(self, now_ms: int) -> list[Action]:
        alone = self.profile == PLAIN
        actions: list[Action] = []
        for victim, motion in sorted(self.seen.items()):
            actions += self.claim_motion(now_ms, self.id, _in_the_way(self, motion), victim if alone else EVERYBODY)
        return actions


class Expel(Liar):
    """Lure the outermost robots out of range: claim that invented robots race outwards past them.

    A robot out of range gets no audits, and stops there. The claimed speed is the highest that decoders accept. The
    attacker uses as many ids as a neighbour table holds, as often as its a-node's rate limit allows.
    """

    period_ms = 20
    FASTEST_MPS: ClassVar[float] = 1e6
    NAMES: ClassVar[int] = 24
    VICTIMS: ClassVar[int] = 3
    _turn = 0

    def on_wake(self, now_ms: int) -> list[Action]:
        if len(self.seen) < 2:
            return []
        heard = self.seen.values()
        middle_x, middle_y = (sum(each) / len(heard) for each in zip(*((at.x_m, at.y_m) for at in heard), strict=True))

        def out_m(other: Motion) -> float:
            return math.hypot(other.x_m - middle_x, other.y_m - middle_y)

        victims = sorted((self.seen[name] for name in self.plan.ids if name in self.seen), key=out_m)[-self.VICTIMS :]
        victim = victims[self._turn % len(victims)]
        far_m = max(out_m(victim), 1e-9)
        away_x, away_y = (victim.x_m - middle_x) / far_m, (victim.y_m - middle_y) / far_m
        claim = victim.x_m - away_x, victim.y_m - away_y, self.FASTEST_MPS * away_x, self.FASTEST_MPS * away_y
        actions = self.claim_motion(now_ms, INVENTED + self._turn % self.NAMES, claim)
        self._turn += bool(actions)
        return actions


class NotANumber(Liar):
    """Broadcast states of NaN and infinity under every id: a sum with NaN stays NaN."""

    period_ms = 100

    def on_wake(self, now_ms: int) -> list[Action]:
        names, dice = self.others(), self.plan.chance
        name = names[int(dice.integers(len(names)))] if names else self.id
        numbers = [(math.nan, 0.0, -math.inf, 1e30)[int(each)] for each in dice.integers(0, 4, 4)]
        numbers[int(dice.integers(2))] = math.nan  # in the position, which every controller reads
        return self.claim_motion(now_ms, name, numbers)


class SeizeOrders(Liar):
    """Stop all robots in the gateway's name: forge an order with the highest number and a stop, and replay an order.

    A robot that accepts the first one rejects all later valid orders.

    Attributes:
        key: signs the orders; its own key, unless a test sets the gateway's.
    """

    period_ms = 100
    _heard: bytes = b""
    _heard_ms = 0
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.key = Ed25519PrivateKey.from_private_bytes(self.plan.chance.bytes(SIGNER_KEY_BYTES))

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        """Store the gateway's last order, for its mission number and its time."""
        is_order = packet[0] == driven.KIND_ORDER and len(packet) >= ORDER.size + SIGNATURE_BYTES
        if is_order and ORDER.decode(packet)["signer"] == GATEWAY:
            self._heard, self._heard_ms = packet, now_ms
        return super().on_packet(now_ms, packet)

    def on_wake(self, now_ms: int) -> list[Action]:
        last = ORDER.decode(self._heard) if self._heard else {"mission": 1, "said": self._heard_ms}
        fields = {
            "mission": last["mission"],
            "signer": GATEWAY,
            "said": last["said"] + now_ms - self._heard_ms,
            "id": 0,
        }
        forged = (
            ORDER.encode(**fields, number=MOST, action=TELL_WHEELS, body=driven.ORDER_WHEELS.encode(left=0, right=0)),
            ORDER.encode(**fields, number=0, action=TELL_STOP, body=b""),
        )
        packets = [raw + self.key.sign(raw) for raw in forged] + [self._heard] * bool(self._heard)
        actions = self.send(now_ms, packets[self._turn % len(packets)], EVERYBODY)
        self._turn += bool(actions)
        return actions


class Pretender(Liar):
    """Base of attacks on other protocols: stores all claims, and claims places in the robot's own name.

    Attributes:
        claimed: by robot id, the time of its last claim, ms, and the three claimed places.
    """

    scene: ClassVar[Scene] = "protocol"
    period_ms = 250

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.claimed: dict[int, tuple[int, list[int]]] = {}

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        if said := fields_of(CLAIM, packet):
            _, rob_id, _, *places = said
            self.claimed[rob_id] = now_ms, places
        return super().heard(now_ms, packet)

    def claim(self, now_ms: int, here: int, holds: int, wants: int = NOWHERE) -> list[Action]:
        return self.send(now_ms, CLAIM.form.pack(KIND_CLAIM, self.id, now_ms, here, holds, wants), EVERYBODY)


class HogCells(Pretender):
    """Claim the cells that the robots next in turn ask for."""

    def on_wake(self, now_ms: int) -> list[Action]:
        """Claim the cells wanted by the robots with the oldest claims: they drive next."""
        next_first = sorted((heard_ms, places) for heard_ms, places in self.claimed.values())
        wanted = [wants for _, (_, _, wants) in next_first if wants != NOWHERE]
        return self.claim(now_ms, *wanted[:2]) if len(wanted) > 1 else []


class ClaimArea(Pretender):
    """Claim in each turn to be at another unvisited place, instead of the true one.

    It claims once a turn: receivers drop both claims if one comes earlier than an honest robot's would (places.py).
    """

    period_ms = 0
    _turn = 0

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        if not (self.lies(now_ms) and isinstance(output, Send) and fields_of(CLAIM, output.payload)):
            return super().send_output(now_ms, output)
        here, following = (self.places[(self._turn + more) % len(self.places)] for more in range(2))
        self._turn += 1
        return self.claim(now_ms, here, following)

    @property
    def places(self) -> Sequence[int]:
        """Return the places to claim."""
        assert isinstance(self._honest, PlaceController), "the attack needs a controller that visits places"
        return [place for place, (at_ms, _) in enumerate(self._honest.visits) if not at_ms] or PLACES


class ClaimVisits(ClaimArea):
    """Claim half of the places without end, so that no robot goes there."""

    @property
    def places(self) -> Sequence[int]:
        return PLACES[len(PLACES) // 2 :]


class PointElsewhere(Pretender):
    """Claim that the last sighting was beside the robot farthest from it, and hide own sightings."""

    _seen: tuple[int, float, float] = 0, 0.0, 0.0  # until the first sighting

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        if said := fields_of(SIGHTING, packet):
            self._seen = said[3:]
        return super().on_packet(now_ms, packet)

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        hides = self.lies(now_ms) and isinstance(output, Send) and fields_of(SIGHTING, output.payload)
        return [] if hides else super().send_output(now_ms, output)

    def on_wake(self, now_ms: int) -> list[Action]:
        assert isinstance(self._honest, PeerController), "the attack needs a controller that reports sightings"
        number, *at_m = self._seen
        others = ((each.x_m, each.y_m) for each in self._honest.others.values())
        x, y = max(others, key=lambda place_m: math.dist(place_m, at_m))
        return self.send(now_ms, SIGHTING.form.pack(KIND_SIGHTING, self.id, now_ms, number, x, y), EVERYBODY)


def _in_the_way(liar: Liar, victim: Motion) -> tuple[float, float, float, float]:
    return spoofed_state((victim.x_m, victim.y_m), liar.plan.goal_m)
