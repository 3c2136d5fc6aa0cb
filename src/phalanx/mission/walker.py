"""The walker: experience in, decoded node and next instruction out; or *not validated*, and why.

Pure: `step(state, experience)` gives the next state and an outcome, and the same two give the same again on every
machine, which is how peers replay it. It never acts on what it has not decoded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import DIGEST_BYTES, sha3_256
from phalanx.errors import UsageError

from .fix import Fix, agreement, allowed_m, explains, fix_from, seen_again
from .gate import Gate, Hint, StartKey, join_shares, parse_start_key
from .observable import Experience, Landmark
from .opening import Opened, OpenWay, open_found
from .outcome import Kind, Order, Outcome, Reason
from .records import OPEN_START, ROAM, START, EncodedMission, Profile
from .refused import Altered, MalformedMission
from .route import Map
from .sealed import visited_hash
from .search import Budget, Candidate, Found, PaperSearch, distance_m, search_sealed, turns_of
from .walk import Event, Phase
from .walk import step as next_phase

PLANE_M = 5e5  # robots are nearer to the map's origin than this
SIGHT_M = 1e3


@dataclass(frozen=True, slots=True)
class State:
    """All that a walk remembers. `State()` is its beginning."""

    phase: Phase = Phase.SEEKING
    at: int | None = None
    target: int | None = None
    t_s: float = -math.inf
    since_s: float | None = None
    turned_s: float = -math.inf
    fixed_at_m: float = 0.0
    left_at_m: float = 0.0
    opened: Mapping[int, Opened] = field(default_factory=lambda: MappingProxyType({}))
    lengths_m: Mapping[tuple[int, int], float] = field(default_factory=lambda: MappingProxyType({}))
    blocked: frozenset[tuple[int, int]] = frozenset()
    others: frozenset[int] = frozenset()
    heard: tuple[bytes, ...] = ()
    tried: frozenset[bytes] = frozenset()

    @property
    def known(self) -> tuple[Landmark, ...]:
        """Landmarks that were decoded, where they truly are."""
        return tuple(node.landmark for node in self.opened.values() if node.landmark is not None)


class Walker:
    """One mission, ready to be walked; it holds nothing that a walk changes.

    Args:
        mission: parsed, and checked by `signing` if it came from outside.
        key: the start key; without one a sealed mission must have been built with an open start.
    Raises: UsageError: the key is missing. Altered: it is another mission's. MalformedMission: it makes no sense.
    """

    def __init__(
        self, mission: EncodedMission, key: StartKey | None = None, config: MissionConfig | None = None
    ) -> None:
        self.mission = mission
        self.config = config or MissionConfig()
        self.map = Map(mission)
        self._paper = PaperSearch(mission, self.config)
        self._turns = turns_of(self.config)
        self._gates: dict[int, Gate] = {}
        self._starts = tuple(i for i, node in enumerate(mission.nodes) if node.flags & START)
        if mission.header.profile is Profile.SEALED:
            if key is None:
                if not mission.header.flags & OPEN_START:
                    raise UsageError("a sealed mission without its start key", "build wrote it beside the file")
                key = parse_start_key(mission.start)
            if key.mission_id != mission.header.mission_id:
                raise Altered("the start key belongs to another mission")
            if any(node >= len(mission.nodes) for node in key.gates):
                raise MalformedMission("a start key for a node that is not there")
            self._gates = key.gates
            self._starts = tuple(key.gates)

    def step(self, state: State, seen: Experience) -> tuple[State, Outcome]:
        """The next state, and what came of an experience."""
        if state.phase in (Phase.HELD, Phase.DONE):
            return state, Outcome(self.order(state), reason=Reason.STOPPED)
        if not seen.t_s >= state.t_s:
            return state, Outcome(self.order(state), reason=Reason.CLOCK)
        since = seen.t_s if state.since_s is None else state.since_s
        state = replace(state, t_s=seen.t_s, since_s=since, heard=self._heard(state, seen))
        seen = self._sane(seen)
        budget = Budget(
            self.config.hash_tries if self.mission.header.profile is Profile.PAPER else self.config.kdf_tries
        )
        again = seen_again(self.config, seen, state.known, seen.travelled_m - state.fixed_at_m)
        # Whoever sees where they are has no heading to search for.
        turning = again is None and seen.t_s - state.turned_s >= self.config.heading_retry_s
        newly_tried: set[bytes] = set()
        opened, fix, reason = None, None, Reason.NOTHING_SENSED
        turns = (0.0, *self._turns) if turning else (0.0,)
        shifted: list[tuple[Found, Fix]] = []
        for found in self._search(state, self._unexplained(state, seen), turns, newly_tried, budget):
            opened, fix, reason = self._believe(state, seen, found, shifted)
            if opened is not None:
                break
        state = self._remember_tried(state, newly_tried, opened)
        if opened is not None:
            return self._advance(state, seen, opened, fix, budget.used)
        if turning and budget.used:
            state = replace(state, turned_s=seen.t_s)
        if reason is Reason.NOTHING_SENSED and (budget.used or seen.landmarks or seen.sensors):
            reason = Reason.BUDGET if budget.left <= 0 else Reason.NO_MATCH
        if again is not None:
            state = replace(state, fixed_at_m=seen.travelled_m)
        state, event, why = self._not_validated(state, seen)
        return state, Outcome(self.order(state), reason=why or reason, fix=again, trials=budget.used, event=event)

    def report(self, state: State) -> tuple[tuple[int, bytes], ...]:
        """(node, proof) of all that was decoded, for a robot that is met: hashes, never raw data (§VI-C)."""
        return tuple((node, opened.proof) for node, opened in sorted(state.opened.items()))

    def hear_report(self, state: State, report: tuple[tuple[int, bytes], ...]) -> State:
        """The state after another robot told where it was; what it cannot prove is ignored (sealed profile).

        In the paper profile nothing is stored to check a proof with, and a robot's word is taken: a liar can keep
        others from going somewhere, and no more.
        """
        nodes = self.mission.nodes
        checked = self.mission.header.profile is Profile.SEALED
        believed = {
            node
            for node, proof in report
            if 0 <= node < len(nodes) and (not checked or visited_hash(proof) == nodes[node].visited)
        }
        return replace(state, others=state.others | believed)

    def candidates(self, state: State) -> tuple[int, ...]:
        """Nodes that the robot may try now: its target, and whatever else is still dark and has become possible.

        Of those decoded before only the target counts, or two doors in view would take turns for ever.
        """
        if self._roams:
            wanted: Iterable[int] = range(len(self.mission.nodes))
        elif state.at is None:
            wanted = self._starts
        elif self.mission.header.profile is Profile.SEALED:
            wanted = self.map.after[state.at]
        else:
            frontier = {node for before in state.opened for node in self.map.after[before]}
            wanted = dict.fromkeys((*self.map.after[state.at], *sorted(frontier)))
        return tuple(
            node
            for node in wanted
            if (node not in state.opened or node == state.target) and self.map.may_enter(node, state.opened)
        )

    @property
    def _roams(self) -> bool:
        return bool(self.mission.header.flags & ROAM) and self.mission.header.profile is Profile.PAPER

    def _heard(self, state: State, seen: Experience) -> tuple[bytes, ...]:
        # Longer ones are nobody's we know, and are kept at the size of those that are.
        new = (value if len(value) <= DIGEST_BYTES else sha3_256(value) for value in seen.messages)
        return tuple(dict.fromkeys((*state.heard, *new)))[-self.config.messages_kept :]

    @staticmethod
    def _sane(seen: Experience) -> Experience:
        """What was experienced, without what no robot can: a pose that is no number, things beyond a kilometre."""
        if not (abs(seen.x_m) < PLANE_M and abs(seen.y_m) < PLANE_M and abs(seen.heading_rad) < PLANE_M):
            return replace(seen, x_m=PLANE_M, y_m=PLANE_M, heading_rad=0.0, landmarks=())
        near = tuple(landmark for landmark in seen.landmarks if distance_m(seen, landmark) < SIGHT_M)
        return replace(seen, landmarks=near, travelled_m=max(0.0, min(seen.travelled_m, 1e9)))

    def _unexplained(self, state: State, seen: Experience) -> Experience:
        """What was experienced, without the landmarks that are known to be other nodes' than the target's."""
        known = tuple(
            node.landmark for i, node in state.opened.items() if node.landmark is not None and i != state.target
        )
        return replace(
            seen, landmarks=tuple(landmark for landmark in seen.landmarks if not explains(self.config, known, landmark))
        )

    def _search(
        self, state: State, seen: Experience, turns: tuple[float, ...], newly_tried: set[bytes], budget: Budget
    ) -> Iterator[Found]:
        nodes = self.candidates(state)
        if self.mission.header.profile is Profile.PAPER:
            released = state.opened[state.at].released if state.at is not None else b""
            return self._paper.run(nodes, seen, state.heard, released, turns, budget)
        locks = [lock for node in nodes for lock in self._locks(state, node)]
        return search_sealed(
            self.mission, self.config, locks, seen, state.heard, turns, state.tried, newly_tried, budget
        )

    def _locks(self, state: State, node: int) -> Iterator[Candidate]:
        gate, hints = self._gate(state, node)
        record = self.mission.nodes[node]
        if gate is not None and len(hints) == len(record.aliases):
            for a, hint in enumerate(hints):
                yield Candidate(node, a, gate, hint)

    def _gate(self, state: State, node: int) -> tuple[bytes | None, tuple[Hint, ...]]:
        if node in self._gates and state.at is None:
            return self._gates[node].share, self._gates[node].hints
        shares = [
            way.gate
            for before in self.map.before[node]
            if before in state.opened
            for way in state.opened[before].ways
            if way.target == node and way.gate is not None
        ]
        if not shares:
            return None, ()
        joined = join_shares([gate.share for gate in shares]) if node in self.map.joins else shares[0].share
        return joined, shares[0].hints

    def _believe(
        self, state: State, seen: Experience, found: Found, shifted: list[tuple[Found, Fix]]
    ) -> tuple[Opened | None, Fix | None, Reason]:
        """A found node opened, with its fix; or the reason not to believe it."""
        try:
            opened = open_found(self.mission, found, seen)
        except Altered:
            return None, None, Reason.ALTERED
        if found.observed is None or opened.landmark is None:
            return opened, None, Reason.NO_MATCH
        fix = fix_from(seen, found.observed, opened.landmark, found.turn_rad)
        if fix.moved_m > allowed_m(self.config, seen.travelled_m - state.fixed_at_m):
            return None, None, Reason.DRIFT
        agree, broken = agreement(self.config, seen, fix, found.observed, state.known)
        if broken > agree:
            return None, None, Reason.CONTRADICTED
        if found.turn_rad and not agree:
            # Nine turns are nine times as many chances of a false match: a second landmark has to say the same.
            second = any(
                other.observed is not found.observed
                and other.turn_rad == found.turn_rad
                and math.sqrt((was.x_m - fix.x_m) ** 2 + (was.y_m - fix.y_m) ** 2) <= self.config.agree_m
                for other, was in shifted
            )
            shifted.append((found, fix))
            if not second:
                return None, None, Reason.CONTRADICTED
        return opened, fix, Reason.NO_MATCH

    def _remember_tried(self, state: State, newly_tried: set[bytes], opened: Opened | None) -> State:
        if opened is not None and opened.node not in state.opened:
            return replace(state, tried=frozenset())  # other gates, other tries
        if not newly_tried:
            return state
        tried = state.tried | newly_tried
        return replace(state, tried=tried if len(tried) <= self.config.tried_limit else frozenset(newly_tried))

    def _advance(
        self, state: State, seen: Experience, opened: Opened, fix: Fix | None, trials: int
    ) -> tuple[State, Outcome]:
        lengths = dict(state.lengths_m)
        if state.at is not None and opened.node in self.map.after[state.at]:
            lengths[state.at, opened.node] = self._length(state, seen, opened)
        nodes = {**state.opened, opened.node: opened}
        over = opened.node in self.map.finals or (not self.map.finals and len(nodes) == len(self.mission.nodes))
        event = Event.COMPLETED if over else Event.DECODED
        state = replace(
            state,
            phase=next_phase(state.phase, event),
            at=opened.node,
            since_s=seen.t_s,
            fixed_at_m=seen.travelled_m if fix else state.fixed_at_m,
            left_at_m=seen.travelled_m,
            opened=MappingProxyType(nodes),
            lengths_m=MappingProxyType(lengths),
            # A way that was blocked an hour ago may be free: whoever got on tries again.
            blocked=frozenset(way for way in state.blocked if way[0] == opened.node),
        )
        state = self._aim(state)
        return state, Outcome(self.order(state), opened, fix=fix, trials=trials, event=event)

    def _length(self, state: State, seen: Experience, opened: Opened) -> float:
        walked = seen.travelled_m - state.left_at_m
        source = state.opened[state.at].place_m if state.at is not None else None
        if source is None or opened.place_m is None:
            return max(walked, 0.0)
        dx, dy = opened.place_m[0] - source[0], opened.place_m[1] - source[1]
        return max(walked, math.sqrt(dx * dx + dy * dy))

    def _aim(self, state: State) -> State:
        """The state with its next target, or held if there is none and something is still to be done."""
        if state.phase is not Phase.SEEKING or state.at is None:
            return state
        target = self.map.next_target(state.at, state.opened, state.others, state.lengths_m, state.blocked)
        if target is not None:
            return replace(state, target=target)
        explored = not self.map.finals and not state.blocked
        return replace(state, target=None, phase=Phase.DONE if explored else next_phase(state.phase, Event.NO_WAY))

    def _timeout_s(self, state: State) -> float:
        own = 0 if state.at is None else self.mission.nodes[state.at].timeout_s
        return own or self.config.timeout_s

    def _not_validated(self, state: State, seen: Experience) -> tuple[State, Event | None, Reason | None]:
        """The state after a step in which nothing was validated: time-outs, blocked ways, and the way back."""
        since = seen.t_s if state.since_s is None else state.since_s
        if self._has_passed(state, seen):
            state = replace(
                state,
                at=state.target,
                phase=next_phase(state.phase, Event.PASSED),
                since_s=seen.t_s,
                left_at_m=seen.travelled_m,
            )
            state = self._aim(state)
            return state, Event.PASSED, Reason.NO_WAY if state.phase is Phase.HELD else None
        if state.phase is Phase.RETURNING and self._is_near(state.at, state, seen):
            state = self._aim(replace(state, phase=next_phase(state.phase, Event.BACK), since_s=seen.t_s))
            return state, Event.BACK, Reason.NO_WAY if state.phase is Phase.HELD else None
        event = None
        if seen.t_s - since > self._timeout_s(state):
            event = Event.TIMED_OUT
        elif seen.blocked and state.phase is Phase.SEEKING and state.at is not None:
            event = Event.BLOCKED
        if event is None:
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
        """Whether the target is a place that is known, and reached again by a pose that can be trusted."""
        known = state.opened.get(state.target) if state.target is not None else None
        if state.phase is not Phase.SEEKING or known is None or known.place_m is None:
            return False
        fresh = seen.travelled_m - state.fixed_at_m <= self.config.passing_m
        return fresh and self._is_near(state.target, state, seen)

    def _is_near(self, node: int | None, state: State, seen: Experience) -> bool:
        place = state.opened[node].place_m if node is not None else None
        if place is None:
            return True
        dx, dy = place[0] - seen.x_m, place[1] - seen.y_m
        return math.sqrt(dx * dx + dy * dy) <= self.config.arrive_m

    def order(self, state: State) -> Order:
        """The instruction in force."""
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
        return Order(Kind.GO, way.target, here.place_m, way.direction_rad, toward)
