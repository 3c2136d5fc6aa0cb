"""Which nodes may be found now, what a search comes upon, and which finds are believed.

The search needs the robot's keyring. Checking what another robot says it found needs none: a hash or one KDF, the
reading, and the same judgement. Both ask the same methods here, so that what is believed is also provable.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.config.parameter import made_once
from phalanx.errors import UsageError
from phalanx.mission.file.canonical import AT_POSITION
from phalanx.mission.file.records import OPEN_START, ROAM, START, EncodedMission, Profile
from phalanx.mission.observable import Experience, InSight, Landmark, Offset, cell_of, middle_of
from phalanx.mission.pose.spread import pose_spread
from phalanx.mission.refused import Altered, MalformedMission

from .chart import Chart
from .claims import Claim, Found, Unshown, shows, unlock
from .constellation import MISTAKEN, candidate_matches, constellation, expected_chance_matches
from .fix import (
    Fix,
    Match,
    agreeing,
    allowed_m,
    distance_m,
    fits,
    fix_from,
    is_ambiguous,
    is_there,
    known_in,
    length_m,
    pose_doubt_m,
    sight_of,
    sighting,
    unambiguous,
)
from .gate import Gate, Hint, StartKey, join_shares, parse_start_key
from .glance import NOBODY, SearchTarget, glance, search_target_of
from .opening import Known, Opened, open_found
from .route import Map
from .search import LANDMARK_PLACES, Budget
from .search_paper import PaperSearch
from .search_sealed import Candidate, search_sealed
from .state import Keyring, Reason, State

# An offset is in millimetres.
MIDDLE_M = 0.002
Believed = tuple[Opened | None, Fix | None, Reason]  # why not, if nothing was opened


@dataclass(frozen=True, slots=True)
class Find:
    """Result of a search."""

    keys: Keyring  # with what was tried; a new node's gates are not among them yet
    opened: Opened | None  # what was found, or None; then `reason` says why not
    fix: Fix | None
    reason: Reason
    trials: int  # hashes or KDFs


class _Decoded:
    """Decoded nodes, indexed for the queries of every step.

    Attributes:
        candidates: nodes that it may try, by its last node and its target.
        gates: those open to whom `gazes` and `again` are made for.
        gazes: what it looks for at a glance, by its last node and its target; None where a glance does not do.
        again: known landmarks that it may have to find again as another node, likewise.
    """

    def __init__(self, opened: Mapping[int, Known]) -> None:
        placed = [(node.landmark, i) for i, node in opened.items() if node.landmark is not None]
        self.chart = Chart([landmark for landmark, _ in placed], [i for _, i in placed])
        self.candidates: dict[tuple[int | None, int | None], tuple[int, ...]] = {}
        self.gates: Mapping[tuple[int, int], Gate] = {}
        self.gazes: dict[tuple[int | None, int | None], SearchTarget | None] = {}
        self.again: dict[tuple[int | None, int | None], frozenset[int]] = {}


class Finder:
    """The search of one mission.

    Args:
        key: the start key, or None: of a sealed mission without an open start nothing is found, only checked.
        replays: nothing is to be found, so no key is needed.
    Raises: UsageError: the key is missing. Altered: it is another mission's. MalformedMission: it makes no sense.
    """

    def __init__(self, mission: EncodedMission, key: StartKey | None, config: MissionConfig, *, replays: bool) -> None:
        self.mission, self.config = mission, config
        self.map = Map(mission)
        self._is_paper = mission.header.profile is Profile.PAPER
        self._roams = bool(mission.header.flags & ROAM) and self._is_paper
        self._search = PaperSearch(mission, config)
        self._decoded = made_once(_Decoded)
        self._starts = tuple(i for i, node in enumerate(mission.nodes) if node.flags & START)
        self._gates: dict[int, Gate] = {}
        if not self._is_paper and key is None and mission.header.flags & OPEN_START:
            key = parse_start_key(mission.start)
        if not self._is_paper and key is not None:
            if key.mission_id != mission.header.mission_id:
                raise Altered("the start key belongs to another mission")
            if any(node >= len(mission.nodes) for node in key.gates):
                raise MalformedMission("a start key for a node that is not there")
            self._gates = key.gates
        if not (replays or self._is_paper or self._gates):
            raise UsageError("a sealed mission without its start key", "build wrote it beside the file")

    def candidates(self, state: State) -> tuple[int, ...]:
        """Nodes that the robot may try now: its target, and whatever else is still dark and has become possible.

        Of those decoded before only the target counts, or two doors in view would take turns for ever.
        """
        known = self._decoded(state.opened)
        here = state.at, state.target
        if here not in known.candidates:
            known.candidates[here] = self._candidates(state)
        return known.candidates[here]

    def _candidates(self, state: State) -> tuple[int, ...]:
        if self._roams:
            wanted: Iterable[int] = range(len(self.mission.nodes))
        elif state.at is None:
            wanted = self._starts
        elif not self._is_paper:
            wanted = self.map.after[state.at]
        else:
            frontier = {node for before in state.opened for node in self.map.after[before]}
            wanted = dict.fromkeys((*self.map.after[state.at], *sorted(frontier)))
        return tuple(
            node
            for node in wanted
            if (node not in state.opened or node == state.target) and self.map.may_enter(node, state.opened)
        )

    def tries_in_vain(self, state: State, seen: Experience) -> int | None:
        """How many hashes find nothing, where a glance says so; None where somebody has to look."""
        if not isinstance(seen.landmarks, InSight):
            return None
        known, here = self._known(state), (state.at, state.target)
        if here not in known.gazes:
            # What is searched although it is known takes somebody who looks.
            known.gazes[here] = None if self._again(state) else self._search_target(state, known.chart)
        gaze, most = known.gazes[here], self.config.hash_tries
        if gaze is None:
            return None
        left = glance(gaze, seen.landmarks.rows, seen.x_m, seen.y_m, pose_spread(seen.spread), most)
        return None if left == NOBODY else most - left

    def _known(self, state: State) -> _Decoded:
        known = self._decoded(state.opened)
        if known.gates is not state.keys.gates:
            known.gates, known.gazes, known.again = state.keys.gates, {}, {}
        return known

    def _again(self, state: State) -> frozenset[int]:
        """Numbers of known landmarks that may be another node's too, which is still to be found.

        Where that is, is unknown. But one thing is in the middle of cells that are counted from one offset.
        """
        known, here = self._known(state), (state.at, state.target)
        if here not in known.again:
            coding, offsets = self.mission.header.coding, set[Offset]()
            for node in self.candidates(state):
                if node not in state.opened:
                    aliases = self.mission.nodes[node].aliases
                    offsets.update(alias.offset for alias in aliases if self._is_paper)
                    offsets.update(lock.hint.offset for lock in self._locks(state, node) if not self._is_paper)
            known.again[here] = frozenset(
                number
                for number, thing in enumerate(known.chart.landmarks)
                if any(_is_middle(coding, offset, thing) for offset in offsets)
            )
        return known.again[here]

    def _same(self, state: State, claim: Claim) -> frozenset[int]:
        """Numbers of known landmarks that are the thing claimed."""
        if claim.shape.place not in LANDMARK_PLACES:
            return frozenset()
        x, y, _ = middle_of(self.mission.header.coding, claim.offset, claim.cell)
        landmarks, near_m = self.chart(state).landmarks, self.config.agree_m / 2
        return frozenset(i for i, each in enumerate(landmarks) if length_m(each.x_m - x, each.y_m - y) <= near_m)

    def _search_target(self, state: State, chart: Chart) -> SearchTarget | None:
        nodes, search = self.candidates(state), self._search
        if self._is_paper:
            (shapes, *more), others = search.parts(nodes, self._released(state))
            asked = [(shape, 0) for shape in others]
        else:
            shapes, more = search.nothing(), []
            locks = [lock for node in nodes for lock in self._locks(state, node)]
            asked = [(lock.hint.shape, self.mission.nodes[lock.node].reach_dm) for lock in locks]
        # Who searches twice, and for something else in between, has to count tries in that order.
        return None if more else search_target_of(self.config, chart, state.target, search.steps, shapes, asked)

    def look(self, state: State, seen: Experience) -> Find:
        """Return the result of the search."""
        budget, keys = Budget(self.config.hash_tries if self._is_paper else self.config.kdf_tries), state.keys
        opened, fix, reason = None, None, Reason.NOTHING_SENSED
        failed: set[bytes] = set()
        unconfirmed: dict[Match, Opened] = {}
        again = self._again(state)
        for found in self._found(state, self._unexplained(state, seen, again), failed, budget):
            # A known node's, unless it is the very thing: as auditors ask.
            same = self._same(state, found.claim) if again else frozenset()
            if again and found.seen not in (None, *self._unexplained(state, seen, same).landmarks):
                continue
            opened, fix, reason = self._believe(state, seen, found, unconfirmed)
            if opened is not None:
                break
        if opened is None and unconfirmed:
            opened, fix, reason = self._together(state, seen, unconfirmed)
        if opened is not None and opened.node not in state.opened:
            keys = replace(keys, tried=frozenset())  # other gates, other tries
        else:
            keys = keys.remember(failed, self.config.tried_limit)
        if reason is Reason.NOTHING_SENSED:
            reason = self.nothing(state, seen, budget.used).reason
        return Find(keys, opened, fix, reason, budget.used)

    def nothing(self, state: State, seen: Experience, tries: int) -> Find:
        """Return the result of a search that finds nothing."""
        reason = Reason.NOTHING_SENSED
        if tries or seen.landmarks or seen.sensors:
            most = self.config.hash_tries if self._is_paper else self.config.kdf_tries
            reason = Reason.BUDGET if tries >= most else Reason.NO_MATCH
        return Find(state.keys, None, None, reason, tries)

    def check(self, state: State, seen: Experience, claim: Claim) -> tuple[Opened, Fix | None]:
        """The node that a robot in this state says it found, opened, with its fix: one hash or one KDF.

        Args:
            seen: made from the reading that it kept.
        Raises: Unshown: the robot may not have found it now, or has not seen it, or it opens nothing. Altered.
        """
        clear = self._unexplained(state, seen, self._same(state, claim))
        if claim.node not in self.candidates(state):
            raise Unshown("no way leads to the node claimed")
        found = shows(self.mission, self.config, claim, clear, state.heard, self._released(state))
        if found is None:
            raise Unshown("the reading does not show what is claimed")
        if (key := unlock(self.mission, claim)) is None:
            raise Unshown("the claim opens nothing")
        opened, fix, reason = self._believe(state, seen, replace(found, key=key))
        if opened is None:
            raise Unshown(f"a claim not to be believed: {reason.value}")
        return opened, fix

    def chart(self, state: State) -> Chart:
        """The landmarks that were decoded."""
        return self._decoded(state.opened).chart

    def _unexplained(self, state: State, seen: Experience, again: Container[int] = ()) -> Experience:
        """Return the observation without landmarks that are too far off or belong to other nodes than the target.

        Args:
            again: numbers of known landmarks that may be another node's too.
        """
        chart = self.chart(state)
        left = tuple(
            landmark
            for landmark, known in zip(
                seen.landmarks, chart.fitting(seen, sight_of(self.config), self.config.tolerance_m), strict=True
            )
            if distance_m(seen, landmark) <= self.config.decode_m
            and all(chart.nodes[number] == state.target or number in again for number in known)
        )
        return seen if len(left) == len(seen.landmarks) else replace(seen, landmarks=left)

    def _found(self, state: State, seen: Experience, failed: set[bytes], budget: Budget) -> Iterator[Found]:
        nodes = self.candidates(state)
        if self._is_paper:
            return self._search.run(nodes, seen, state.heard, self._released(state), budget)
        locks = [lock for node in nodes for lock in self._locks(state, node)]
        return search_sealed(self.mission, self.config, locks, seen, state.heard, state.keys.tried, failed, budget)

    def _released(self, state: State) -> bytes:
        """Return the hash of the previous node that chained nodes need (paper profile)."""
        if not self._is_paper or state.at is None:
            return b""
        return self.mission.nodes[state.at].aliases[state.opened[state.at].alias].mark

    def _locks(self, state: State, node: int) -> Iterator[Candidate]:
        gate, hints = self._gate(state, node)
        record = self.mission.nodes[node]
        if gate is not None and len(hints) == len(record.aliases):
            for a, hint in enumerate(hints):
                yield Candidate(node, a, gate, hint)

    def keys_of(self, state: State, opened: Opened) -> Keyring:
        """The state's keyring with what a node just opened released."""
        gate, _ = self._gate(state, opened.node)
        return state.keys.add(opened, gate, self.mission.header)

    def _gate(self, state: State, node: int) -> tuple[bytes | None, tuple[Hint, ...]]:
        if node in self._gates and state.at is None:
            return self._gates[node].share, self._gates[node].hints
        gates = state.keys.gates
        shares = [gates[before, node] for before in self.map.before[node] if (before, node) in gates]
        if not shares:
            return None, ()
        joined = join_shares([gate.share for gate in shares]) if node in self.map.joins else shares[0].share
        return joined, shares[0].hints

    def _together(self, state: State, seen: Experience, unconfirmed: dict[Match, Opened]) -> Believed:
        """One of several nodes that are believed together, though none is by itself, with the fix that all give."""
        matches = constellation(
            self.config, seen, [*unconfirmed, *candidate_matches(self.config, seen, self.chart(state))]
        )
        opened = next((unconfirmed[pair] for pair in matches if pair in unconfirmed), None)
        if opened is None:
            return None, None, Reason.UNCONFIRMED
        return self._fixed(state, seen, opened, matches)

    def _fixed(self, state: State, seen: Experience, opened: Opened, matches: list[Match]) -> Believed:
        fix = fix_from(self.config, seen, matches)
        if fix.moved_m > allowed_m(self.config, seen.travelled_m - state.fixed_at_m, pose_doubt_m(seen)):
            return None, None, Reason.DRIFT
        return opened, fix, Reason.NO_MATCH

    def _believe(
        self, state: State, seen: Experience, found: Found, unconfirmed: dict[Match, Opened] | None = None
    ) -> Believed:
        """A found node opened, with its fix; or the reason not to believe it.

        Args:
            unconfirmed: takes what may be believed together with others.
        """
        try:
            opened = open_found(self.mission, found, seen)
        except Altered:
            return None, None, Reason.ALTERED
        observed, truth = found.seen, opened.landmark
        if observed is None or truth is None:
            x, y, _ = middle_of(self.mission.header.coding, found.claim.offset, found.claim.cell)
            is_meant = found.claim.shape.place != AT_POSITION or is_there(self.config, seen, x, y)
            return (opened, None, Reason.NO_MATCH) if is_meant else (None, None, Reason.AMBIGUOUS)
        match = sighting(observed, truth, observed.x_m, observed.y_m)
        if not fits(self.config, pose_spread(seen.spread), seen.x_m, seen.y_m, match):
            return None, None, Reason.DRIFT
        if unconfirmed is not None and expected_chance_matches(self.config, seen, [(observed, truth)]) > MISTAKEN:
            unconfirmed[observed, truth] = opened
        if is_ambiguous(self.config, seen, observed, truth):
            return None, None, Reason.AMBIGUOUS
        # What is known and in sight has its say.
        known = [pair for pair in known_in(self.config, seen, self.chart(state)) if pair[0] is not observed]
        matches = agreeing(self.config, seen, [(observed, truth), *known])
        if not any(pair[0] is observed for pair in matches):
            return None, None, Reason.CONTRADICTED
        matches = unambiguous(self.config, seen, matches)
        if not any(pair[0] is observed for pair in matches):
            return None, None, Reason.AMBIGUOUS
        if expected_chance_matches(self.config, seen, matches) > MISTAKEN:
            return None, None, Reason.UNCONFIRMED
        return self._fixed(state, seen, opened, matches)


def _is_middle(coding: CodingConfig, offset: Offset, thing: Landmark) -> bool:
    """Return whether a thing is in the middle of its cell, counted from an offset."""
    x, y, _ = middle_of(coding, offset, cell_of(coding, offset, thing.x_m, thing.y_m))
    return length_m(thing.x_m - x, thing.y_m - y) <= MIDDLE_M
