"""The walker: experience in, decoded node and next instruction out; or *not validated*, and why.

Pure: `step(state, experience)` gives the next state and an outcome, and the same two give the same again on every
machine. It never acts on what it has not decoded.

Under audit a step is two: `look`, which needs the robot's keyring and ends in a claim or nothing, and `advance`, which
needs neither keyring nor search and is what auditors replay.
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

PLANE_M = 5e5  # robots are nearer to the map's origin than this
FAR_M = 1e9  # nor does any drive so far
# To which side of its line a way is tried the first time, when it was blocked, and when it was again.
ASIDE = (0, 1, -1)
# From a face's normal to where nothing is around the end of it.
_OPEN_RAD = {"concave_left": -PI / 4, "concave_right": PI / 4}


class Walker:
    """One mission, ready to be walked; it holds nothing that a walk changes.

    Args:
        mission: parsed, and checked by `check_signature` if it came from outside.
        key: the start key; without one a sealed mission must have been built with an open start.
        replays: it only replays what others walked, which needs no key.
    Raises: UsageError: the key is missing. Altered: it is another mission's. MalformedMission: it makes no sense.
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
        """The next state, and what came of an experience."""
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
        """The state with what was tried in its keyring; the claim that `advance` takes, if any; and tries."""
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
                # Two landmarks in one cell: which of them was meant, the bytes do not tell. The next scan may.
                claim = None
        return state, claim, find.trials

    def advance(self, state: State, seen: Experience, claim: Claim | None = None) -> tuple[State, Outcome]:
        """The next state after an experience in which a robot claims to have found a node, or claims nothing.

        Landmarks decoded before give a fix if the experience shows them.
        Raises: Unshown, Altered: the claim is not borne out.
        """
        if (refused := self._refused(state, seen)) is not None:
            if claim:
                raise Unshown("a claim of a robot that has stopped, or whose clock has")
            return state, refused
        state, seen = self._begun(state, seen), self._sane(seen)
        if claim:
            return self._decoded(state, seen, *self._finder.check(state, seen, claim), 0)
        nothing = Find(state.keys, None, None, Reason.NOTHING_SENSED, 0)
        return self._walked(state, seen, self.pose_from_known(state, seen), nothing)

    def hear(self, state: State, message: bytes) -> State:
        """The state after an encoded message has come."""
        return replace(state, heard=self._heard(state, (message,)))

    def report(self, state: State) -> tuple[tuple[int, bytes], ...]:
        """(node, proof) of all that was decoded, for a robot that is met: hashes, never raw data (§VI-C)."""
        return tuple(sorted(state.keys.proofs.items()))

    def accept_report(self, state: State, report: tuple[tuple[int, bytes], ...]) -> State:
        """The state after another robot told where it was; what it cannot prove is ignored (sealed profile).

        In the paper profile nothing is stored to check a proof with, and a robot's word is taken: a compromised robot
        can make others go elsewhere first, and no more.
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
        """The outcome of an experience that changes nothing, or None."""
        if state.phase in (Phase.HELD, Phase.DONE):
            return Outcome(self.order(state), reason=Reason.STOPPED)
        if not (seen.t_s >= state.t_s and abs(seen.t_s) < LONGEST_S):
            return Outcome(self.order(state), reason=Reason.CLOCK)
        return None

    def _begun(self, state: State, seen: Experience) -> State:
        since = seen.t_s if state.since_s is None else state.since_s
        heard = self._heard(state, seen.messages)
        return replace(state, t_s=seen.t_s, since_s=since, heard=heard)

    def _glance(self, state: State, seen: Experience) -> Find | None:
        """Return the empty result if a glance rules out a find; None if it does not, or if something looks wrong."""
        is_sane = _is_on_plane(seen) and 0.0 <= seen.travelled_m <= FAR_M
        tries = self._finder.tries_in_vain(state, seen) if is_sane else None
        return None if tries is None else self._finder.nothing(state, seen, tries)

    def _heard(self, state: State, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        if not messages:
            return state.heard
        # Longer ones are nobody's we know, and are kept at the size of those that are.
        new = (value if len(value) <= DIGEST_BYTES else sha3_256(value) for value in messages)
        return tuple(dict.fromkeys((*state.heard, *new)))[-self.config.messages_kept :]

    @staticmethod
    def _sane(seen: Experience) -> Experience:
        """Return the observation without impossible values: a pose that is NaN, landmarks beyond a kilometre."""
        if not _is_on_plane(seen):
            return replace(seen, x_m=PLANE_M, y_m=PLANE_M, heading_rad=0.0, landmarks=())
        near = tuple(landmark for landmark in seen.landmarks if distance_m(seen, landmark) < SIGHT_M)
        travelled_m = max(0.0, min(seen.travelled_m, FAR_M))
        if len(near) == len(seen.landmarks) and travelled_m == seen.travelled_m:
            return seen
        return replace(seen, landmarks=near, travelled_m=travelled_m)

    def pose_from_known(self, state: State, seen: Experience) -> Fix | None:
        """The pose that landmarks decoded before tell, if they are seen again.

        Each such fix is no larger than what can have drifted since the last; a lidar that is stuck, or shown a building
        that slides away, gives one at every step. So all of them since the last decode may not come to more than can
        have drifted since then.
        """
        fix, doubt_m = fix_from_known(self.config, seen, self._finder.chart(state)), pose_doubt_m(seen)
        if fix is None or fix.moved_m > allowed_m(self.config, seen.travelled_m - state.fixed_at_m, doubt_m):
            return None
        all_m = length_m(*self._pulled(state, seen, fix))
        return fix if all_m <= allowed_m(self.config, seen.travelled_m - state.left_at_m) else None

    def _pulled(self, state: State, seen: Experience, fix: Fix) -> tuple[float, float]:
        if pose_doubt_m(seen) > self.config.drift_base_m:
            return state.pulled_m  # it knew that it was lost
        return state.pulled_m[0] + (fix.x_m - seen.x_m), state.pulled_m[1] + (fix.y_m - seen.y_m)

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
            pulled_m=(0.0, 0.0),
            opened=MappingProxyType(nodes),
            lengths_m=MappingProxyType(lengths),
            keys=self._finder.keys_of(state, opened),
        )
        if is_new:
            # A way that was blocked an hour ago may be free: whoever got on, to where it never was, tries again.
            state = replace(state, blocked=frozenset(), round=0)
        state = self._aim(state)
        why = Reason.NO_WAY if state.phase is Phase.HELD else None
        return state, Outcome(self.order(state), opened, why, fix, trials, event)

    def _walked(self, state: State, seen: Experience, again: Fix | None, find: Find) -> tuple[State, Outcome]:
        if again is not None:
            state = replace(state, fixed_at_m=seen.travelled_m, pulled_m=self._pulled(state, seen, again))
        state, event, why = self._not_validated(state, seen)
        return state, Outcome(self.order(state), reason=why or find.reason, fix=again, trials=find.trials, event=event)

    def _length(self, state: State, seen: Experience, opened: Opened) -> float:
        walked = seen.travelled_m - state.left_at_m
        source = state.opened[state.at].place_m if state.at is not None else None
        if source is None or opened.place_m is None:
            return max(walked, 0.0)
        return max(walked, length_m(opened.place_m[0] - source[0], opened.place_m[1] - source[1]))

    def _aim(self, state: State) -> State:
        """The state with its next target, over ways that were blocked if there are no others; else done, or held."""
        if state.phase is not Phase.SEEKING or state.at is None:
            return state
        target = self.map.next_target(state.at, state.opened, state.others, state.lengths_m, state.blocked)
        if target is not None:
            return replace(state, target=target)
        is_explored = self._is_explored(state)
        if not is_explored and state.blocked and state.round < self.config.rounds:
            # People walk on, and who comes from elsewhere sees a way that was not seen before.
            return self._aim(replace(state, blocked=frozenset(), round=state.round + 1))
        event = Event.COMPLETED if is_explored else Event.NO_WAY
        return replace(state, target=None, phase=next_phase(state.phase, event))

    def _is_explored(self, state: State) -> bool:
        """Return whether each node of a mission without a final one was decoded, by this robot or, proven, another."""
        # In the paper profile a report proves nothing, and a compromised robot's must not make a mission look whole.
        proven = state.others if self.mission.header.profile is Profile.SEALED else frozenset()
        return not self.map.finals and len(state.opened.keys() | proven) == len(self.mission.nodes)

    def _not_validated(self, state: State, seen: Experience) -> tuple[State, Event | None, Reason | None]:
        """The state after a step in which nothing was validated: time-outs, blocked ways, and the way back."""
        since, event = seen.t_s if state.since_s is None else state.since_s, None
        if self._has_passed(state, seen):
            event = Event.PASSED
            state = replace(state, at=state.target, left_at_m=seen.travelled_m, pulled_m=(0.0, 0.0))
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
            # Nothing was ever validated: there is nothing to go back to.
            return replace(state, phase=Phase.HELD), event, Reason.TIMED_OUT
        if state.phase is Phase.SEEKING and state.target is not None:
            blocked |= {(state.at, state.target)}
        state = replace(state, phase=next_phase(state.phase, event), since_s=seen.t_s, blocked=blocked)
        return state, event, Reason.TIMED_OUT if event is Event.TIMED_OUT else None

    def _has_passed(self, state: State, seen: Experience) -> bool:
        """Return whether the target is a place that is known, and reached again by a pose that can be trusted."""
        known = state.opened.get(state.target) if state.target is not None else None
        if state.phase is not Phase.SEEKING or known is None or known.place_m is None:
            return False
        # At a landmark who is unsure may yet see it; at a bare place nothing ever makes a robot surer.
        sigmas = 1 if known.landmark is None else 2
        is_sure = sigmas * pose_doubt_m(seen) <= self.config.arrive_m
        return is_sure and self._is_near(state.target, state, seen)

    def _is_near(self, node: int | None, state: State, seen: Experience) -> bool:
        place = state.opened[node].place_m if node is not None else None
        return place is None or length_m(place[0] - seen.x_m, place[1] - seen.y_m) <= self.config.arrive_m

    def order(self, state: State) -> Order:
        """Return the instruction in force; the same until something is decoded, given up or reached."""
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
    """1 if a line from the end of a wall has more room on its left, or nobody knows; -1 if on its right."""
    open_rad = _OPEN_RAD.get(corner.type) if corner else None
    if corner is None or corner.orientation_rad is None or direction_rad is None or open_rad is None:
        return 1
    return 1 if wrap_rad(corner.orientation_rad + open_rad - direction_rad) >= 0 else -1
