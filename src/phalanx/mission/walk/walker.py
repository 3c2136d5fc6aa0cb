"""The walker executes a mission: each experience gives a decoded node, or the reason why none, and an instruction.

It is pure: `step(state, experience)` returns the next state and an outcome, the same on every machine. Instructions use
only decoded nodes.

Under audit a step has two parts. `look` searches with the robot's keyring and returns a claim or None. `advance` needs
neither keyring nor search; auditors replay it.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import DIGEST_BYTES, sha3_256
from phalanx.mission.angles import PI, wrap_rad
from phalanx.mission.file.records import EncodedMission, Profile
from phalanx.mission.file.sealed import visited_hash
from phalanx.mission.observable import LONGEST_S, Experience, Landmark
from phalanx.mission.refused import Altered

from .claims import Claim, Unshown
from .constellation import fix_from_known
from .finding import Find, Finder
from .fix import Fix, allowed_m, distance_m, length_m, pose_doubt_m
from .gate import StartKey
from .glance import SIGHT_M
from .opening import Opened, OpenWay
from .state import Event, Kind, Order, Outcome, Phase, Reason, State
from .state import step as next_phase

__all__ = ["State", "Walker"]

PLANE_M = 5e5  # largest plausible coordinate of a robot
FAR_M = 1e9  # largest plausible distance travelled
# Side of the way's line to drive on in round 0, 1 and 2 of trying blocked ways.
ASIDE = (0, 1, -1)
# From the normal of a wall to the free space beside its end.
_OPEN_RAD = {"concave_left": -PI / 4, "concave_right": PI / 4}


class Walker:
    """Executes one mission; immutable, as the state is an argument of each method.

    Args:
        mission: parsed mission, checked by `check_signature` if it is from outside.
        key: the start key; not needed for a sealed mission that was built with an open start.
        replays: the walker only replays other robots' steps, which needs no key.
    Raises: UsageError: the key is missing. Altered: the key belongs to another mission. MalformedMission: the key is
        invalid.
    """

    def __init__(
        self,
        mission: EncodedMission,
        key: StartKey | None = None,
        config: MissionConfig | None = None,
        *,
        replays: bool = False,
    ) -> None:
        self.mission = mission
        self.config = config or MissionConfig()
        self._finder = Finder(mission, key, self.config, replays=replays)
        self.map = self._finder.map

    def step(self, state: State, seen: Experience) -> tuple[State, Outcome]:
        """Return the next state and the outcome of an experience."""
        if (refused := self._refused(state, seen)) is not None:
            return state, refused
        state = self._begun(state, seen)
        if (find := self._glance(state, seen)) is not None:
            return self._walked(state, seen, None, find)
        seen = self._sane(seen)
        find = self._finder.look(state, seen)
        if find.keys is not state.keys:
            state = replace(state, keys=find.keys)
        if find.opened is not None:
            return self._decoded(state, seen, find.opened, find.fix, find.trials)
        return self._walked(state, seen, self.pose_from_known(state, seen), find)

    def look(self, state: State, seen: Experience) -> tuple[State, Claim | None, int]:
        """Search; return the state with failed tries in its keyring, the claim for `advance` or None, and the tries."""
        if self._refused(state, seen) is not None:
            return state, None, 0
        begun = self._begun(state, seen)
        find = self._glance(begun, seen)
        if find is None:
            seen = self._sane(seen)
            find = self._finder.look(begun, seen)
        state, claim = replace(state, keys=find.keys), find.opened.claim if find.opened else None
        if claim is not None:
            try:
                self._finder.check(begun, seen, claim)
            except (Unshown, Altered):
                # With two landmarks in one cell the bytes do not show which was seen; the next scan may.
                claim = None
        return state, claim, find.trials

    def advance(self, state: State, seen: Experience, claim: Claim | None = None) -> tuple[State, Outcome]:
        """Return the next state and the outcome of an experience with a claim to have decoded a node, or with none.

        Known landmarks in the experience give a fix.
        Raises: Unshown, Altered: the claim is not supported.
        """
        if (refused := self._refused(state, seen)) is not None:
            if claim:
                raise Unshown("a claim of a robot that has stopped or whose clock ran backwards")
            return state, refused
        state, seen = self._begun(state, seen), self._sane(seen)
        if claim:
            return self._decoded(state, seen, *self._finder.check(state, seen, claim), 0)
        nothing = Find(state.keys, None, None, Reason.NOTHING_SENSED, 0)
        return self._walked(state, seen, self.pose_from_known(state, seen), nothing)

    def receive(self, state: State, message: bytes) -> State:
        """Return the state after an encoded message was received."""
        return replace(state, heard=self._heard(state, (message,)))

    def report(self, state: State) -> tuple[tuple[int, bytes], ...]:
        """Return (node, proof) of all decoded nodes, for another robot: hashes, never raw data (§VI-C)."""
        return tuple(sorted(state.keys.proofs.items()))

    def accept_report(self, state: State, report: tuple[tuple[int, bytes], ...]) -> State:
        """Return the state after another robot's report; the sealed profile ignores entries without a valid proof.

        The paper profile has no data to check proofs with, so reports are accepted. With a false report a compromised
        robot can only make others visit other nodes first.
        """
        nodes = self.mission.nodes
        checked = self.mission.header.profile is Profile.SEALED
        believed = {
            node
            for node, proof in report
            if 0 <= node < len(nodes) and (not checked or visited_hash(proof) == nodes[node].visited)
        }
        return replace(state, others=state.others | believed)

    def _refused(self, state: State, seen: Experience) -> Outcome | None:
        """Return the outcome of an experience that must not change the state, or None."""
        if state.phase in (Phase.HELD, Phase.DONE):
            return Outcome(self.order(state), reason=Reason.STOPPED)
        if not (seen.t_s >= state.t_s and abs(seen.t_s) < LONGEST_S):
            return Outcome(self.order(state), reason=Reason.CLOCK)
        return None

    def _begun(self, state: State, seen: Experience) -> State:
        """Return the state at the start of a step, with the experience's time and messages."""
        since = seen.t_s if state.since_s is None else state.since_s
        heard = self._heard(state, seen.messages)
        return replace(state, t_s=seen.t_s, since_s=since, heard=heard)

    def _glance(self, state: State, seen: Experience) -> Find | None:
        """Return the empty result if the fast check rules out a find; None if not, or if a value is implausible."""
        is_sane = _is_on_plane(seen) and 0.0 <= seen.travelled_m <= FAR_M
        tries = self._finder.tries_if_ruled_out(state, seen) if is_sane else None
        return None if tries is None else self._finder.empty_find(state, seen, tries)

    def _heard(self, state: State, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        if not messages:
            return state.heard
        # Valid messages have at most DIGEST_BYTES: longer ones are stored as their digest, which bounds the state.
        new = (value if len(value) <= DIGEST_BYTES else sha3_256(value) for value in messages)
        return tuple(dict.fromkeys((*state.heard, *new)))[-self.config.messages_kept :]

    @staticmethod
    def _sane(seen: Experience) -> Experience:
        """Return the experience without implausible values, as a pose of NaN or landmarks beyond a kilometre."""
        if not _is_on_plane(seen):
            return replace(seen, x_m=PLANE_M, y_m=PLANE_M, heading_rad=0.0, landmarks=())
        near = tuple(landmark for landmark in seen.landmarks if distance_m(seen, landmark) < SIGHT_M)
        travelled_m = max(0.0, min(seen.travelled_m, FAR_M))
        if len(near) == len(seen.landmarks) and travelled_m == seen.travelled_m:
            return seen
        return replace(seen, landmarks=near, travelled_m=travelled_m)

    def pose_from_known(self, state: State, seen: Experience) -> Fix | None:
        """Return a fix from known landmarks in sight, or None.

        A fix must not exceed the plausible drift since the last fix. A lidar that is stuck, or deceived by a moving
        scene, gives a fix at every step, so the sum of the fixes since the last decode must not exceed the plausible
        drift since then.
        """
        fix, doubt_m = fix_from_known(self.config, seen, self._finder.chart(state)), pose_doubt_m(seen)
        if fix is None or fix.moved_m > allowed_m(self.config, seen.travelled_m - state.fixed_at_m, doubt_m):
            return None
        all_m = length_m(*self._pulled(state, seen, fix))
        return fix if all_m <= allowed_m(self.config, seen.travelled_m - state.left_at_m) else None

    def _pulled(self, state: State, seen: Experience, fix: Fix) -> tuple[float, float]:
        """Return the sum of the corrections by known landmarks, with this fix."""
        if pose_doubt_m(seen) > self.config.drift_base_m:
            return state.corrected_m  # a large correction is expected: the covariance is large
        return state.corrected_m[0] + (fix.x_m - seen.x_m), state.corrected_m[1] + (fix.y_m - seen.y_m)

    def _decoded(
        self, state: State, seen: Experience, opened: Opened, fix: Fix | None, trials: int
    ) -> tuple[State, Outcome]:
        lengths = dict(state.lengths_m)
        if state.at is not None and opened.node in self.map.after[state.at]:
            lengths[state.at, opened.node] = self._length(state, seen, opened)
        is_new, nodes = opened.node not in state.opened, {**state.opened, opened.node: opened.known}
        over = opened.node in self.map.finals or (not self.map.finals and len(nodes) == len(self.mission.nodes))
        event = Event.COMPLETED if over else Event.DECODED
        state = replace(
            state,
            phase=next_phase(state.phase, event),
            at=opened.node,
            since_s=seen.t_s,
            fixed_at_m=seen.travelled_m if fix else state.fixed_at_m,
            left_at_m=seen.travelled_m,
            corrected_m=(0.0, 0.0),
            opened=MappingProxyType(nodes),
            lengths_m=MappingProxyType(lengths),
            keys=self._finder.keys_of(state, opened),
        )
        if is_new:
            # A blocked way may be free again: after a new node the robot tries all ways again.
            state = replace(state, blocked=frozenset(), round=0)
        state = self._aim(state)
        why = Reason.NO_WAY if state.phase is Phase.HELD else None
        return state, Outcome(self.order(state), opened, why, fix, trials, event)

    def _walked(self, state: State, seen: Experience, again: Fix | None, find: Find) -> tuple[State, Outcome]:
        if again is not None:
            state = replace(state, fixed_at_m=seen.travelled_m, corrected_m=self._pulled(state, seen, again))
        state, event, why = self._not_validated(state, seen)
        return state, Outcome(self.order(state), reason=why or find.reason, fix=again, trials=find.trials, event=event)

    def _length(self, state: State, seen: Experience, opened: Opened) -> float:
        """Return the length of the way to a decoded node: travelled, but at least the straight line."""
        walked = seen.travelled_m - state.left_at_m
        source = state.opened[state.at].place_m if state.at is not None else None
        if source is None or opened.place_m is None:
            return max(walked, 0.0)
        return max(walked, length_m(opened.place_m[0] - source[0], opened.place_m[1] - source[1]))

    def _aim(self, state: State) -> State:
        """Return the state with its next target, over blocked ways if there are no others; else done, or held."""
        if state.phase is not Phase.SEEKING or state.at is None:
            return state
        target = self.map.next_target(state.at, state.opened, state.others, state.lengths_m, state.blocked)
        if target is not None:
            return replace(state, target=target)
        is_explored = self._is_explored(state)
        if not is_explored and state.blocked and state.round < self.config.rounds:
            # People who blocked a way move on, and from another side the robot may see a free way.
            return self._aim(replace(state, blocked=frozenset(), round=state.round + 1))
        event = Event.COMPLETED if is_explored else Event.NO_WAY
        return replace(state, target=None, phase=next_phase(state.phase, event))

    def _is_explored(self, state: State) -> bool:
        """Return True if there is no final node and all nodes were decoded, by this robot or provably by others."""
        # In the paper profile reports prove nothing: a compromised robot must not make a mission look complete.
        proven = state.others if self.mission.header.profile is Profile.SEALED else frozenset()
        return not self.map.finals and len(state.opened.keys() | proven) == len(self.mission.nodes)

    def _not_validated(self, state: State, seen: Experience) -> tuple[State, Event | None, Reason | None]:
        """Return the state after a step without a validated node: handle time-outs, blocked ways, and the way back."""
        since, event = seen.t_s if state.since_s is None else state.since_s, None
        if self._has_passed(state, seen):
            event = Event.PASSED
            state = replace(state, at=state.target, left_at_m=seen.travelled_m, corrected_m=(0.0, 0.0))
        elif state.phase is Phase.RETURNING and self._is_near(state.at, state, seen):
            event = Event.BACK
        if event is not None:
            state = self._aim(replace(state, phase=next_phase(state.phase, event), since_s=seen.t_s))
            return state, event, Reason.NO_WAY if state.phase is Phase.HELD else None
        own_s = 0 if state.at is None else self.mission.nodes[state.at].timeout_s
        if seen.t_s - since > (own_s or self.config.timeout_s):
            event = Event.TIMED_OUT
        elif seen.blocked and state.phase is Phase.SEEKING and state.at is not None:
            event = Event.BLOCKED
        else:
            return state, None, None
        blocked = state.blocked
        if state.at is None:
            # No node was validated yet, so there is none to return to.
            return replace(state, phase=Phase.HELD), event, Reason.TIMED_OUT
        if state.phase is Phase.SEEKING and state.target is not None:
            blocked |= {(state.at, state.target)}
        state = replace(state, phase=next_phase(state.phase, event), since_s=seen.t_s, blocked=blocked)
        return state, event, Reason.TIMED_OUT if event is Event.TIMED_OUT else None

    def _has_passed(self, state: State, seen: Experience) -> bool:
        """Return True if the target was decoded before and the robot is there, with a trustworthy pose."""
        known = state.opened.get(state.target) if state.target is not None else None
        if state.phase is not Phase.SEEKING or known is None or known.place_m is None:
            return False
        # An unsure robot may still see the landmark of its target. At a mere position nothing makes its pose surer.
        sigmas = 1 if known.landmark is None else 2
        is_sure = sigmas * pose_doubt_m(seen) <= self.config.arrive_m
        return is_sure and self._is_near(state.target, state, seen)

    def _is_near(self, node: int | None, state: State, seen: Experience) -> bool:
        place = state.opened[node].place_m if node is not None else None
        return place is None or length_m(place[0] - seen.x_m, place[1] - seen.y_m) <= self.config.arrive_m

    def order(self, state: State) -> Order:
        """Return the current instruction; it changes only when a node is decoded, given up or reached."""
        if state.phase is Phase.DONE:
            return Order(Kind.DONE)
        if state.phase is Phase.HELD:
            return Order(Kind.HOLD)
        if state.at is None:
            return Order(Kind.WAIT)
        here = state.opened[state.at]
        if state.phase is Phase.RETURNING:
            return Order(Kind.BACK, state.at, here.place_m, toward_m=here.place_m)
        way = next((way for way in here.ways if way.target == state.target), OpenWay(-1))
        there = state.opened.get(way.target)
        toward = there.place_m if there else None
        if way.do is not None:
            return Order(Kind.DO, way.target, here.place_m, None, toward, way.do)
        if way.direction_rad is None and toward is None:
            return Order(Kind.WAIT, state.target, here.place_m)
        aside = ASIDE[state.round % len(ASIDE)] * _free_side(here.landmark, way.direction_rad)
        return Order(Kind.GO, way.target, here.place_m, way.direction_rad, toward, aside=aside)


def _is_on_plane(seen: Experience) -> bool:
    return abs(seen.x_m) < PLANE_M and abs(seen.y_m) < PLANE_M and abs(seen.heading_rad) < PLANE_M


def _free_side(corner: Landmark | None, direction_rad: float | None) -> int:
    """Return -1 if a line from the end of a wall has more room on its right, else 1."""
    open_rad = _OPEN_RAD.get(corner.type) if corner else None
    if corner is None or corner.orientation_rad is None or direction_rad is None or open_rad is None:
        return 1
    return 1 if wrap_rad(corner.orientation_rad + open_rad - direction_rad) >= 0 else -1
