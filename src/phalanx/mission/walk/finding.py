"""Determine which nodes may be decoded now, search for them, and decide which matches to accept.

The search needs the robot's keyring. An auditor's check of another robot's claim needs only the reading and one hash or
KDF. Both apply the same rules, with the same methods, so that every accepted match can be proven.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.config.parameter import made_once
from phalanx.errors import UsageError
from phalanx.mission.file.canonical import AT_POSITION
from phalanx.mission.file.records import OPEN_START, ROAM, START, EncodedMission, Profile
from phalanx.mission.observable import Experience, Landmark, Offset, ScanLandmarks, cell_of, middle_of
from phalanx.mission.pose.spread import pose_spread
from phalanx.mission.refused import Altered, MalformedMission

from .chart import Chart
from .claims import Claim, Found, Unshown, match_of_claim, unlock
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

# Tolerance for offsets, which are stored in millimetres.
MIDDLE_M = 0.002
Believed = tuple[Opened | None, Fix | None, Reason]  # the reason counts if no node was opened


@dataclass(frozen=True, slots=True)
class Find:
    """Result of a search."""

    keys: Keyring  # with the failed tries; without the gates of a new node
    opened: Opened | None  # the decoded node; if None, `reason` is set
    fix: Fix | None
    reason: Reason
    trials: int  # number of hashes or KDFs


class _Decoded:
    """Caches for a set of decoded nodes.

    Attributes:
        candidates: nodes to try, by (last node, target).
        gates: the gates for which `gazes` and `again` are valid.
        gazes: targets of the fast check, by (last node, target); None if the full search is needed.
        again: indices of known landmarks that may be those of another node too, by (last node, target).
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
        key: the start key; may be None for the paper profile and for an open start.
        replays: claims are only checked, which needs no key.
    Raises: UsageError: the key is missing. Altered: the key belongs to another mission. MalformedMission: the key is
        invalid.
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
                raise MalformedMission("a start key for a node that does not exist")
            self._gates = key.gates
        if not (replays or self._is_paper or self._gates):
            raise UsageError("a sealed mission without its start key", "use the key file that build wrote beside it")

    def candidates(self, state: State) -> tuple[int, ...]:
        """Return the nodes that the robot may decode now: its target, and reachable nodes that are not decoded.

        Of the decoded nodes only the target is included, or two doors in view would be decoded in turn for ever.
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

    def tries_if_ruled_out(self, state: State, seen: Experience) -> int | None:
        """Return the tries of the fast check if it rules out a find; None if the full search is needed."""
        if not isinstance(seen.landmarks, ScanLandmarks):
            return None
        known, here = self._known(state), (state.at, state.target)
        if here not in known.gazes:
            # Known landmarks that must be searched again need the full search.
            known.gazes[here] = None if self._again(state) else self._search_target(state, known.chart)
        gaze, most = known.gazes[here], self.config.hash_tries
        if gaze is None:
            return None
        left = glance(gaze, seen.landmarks.rows, seen.x_m, seen.y_m, pose_spread(seen.spread), most)
        return None if left == NOBODY else most - left

    def _known(self, state: State) -> _Decoded:
        """Return the caches for the decoded nodes and gates of a state."""
        known = self._decoded(state.opened)
        if known.gates is not state.keys.gates:
            known.gates, known.gazes, known.again = state.keys.gates, {}, {}
        return known

    def _again(self, state: State) -> frozenset[int]:
        """Return the indices of known landmarks that may also be the landmark of a node that is not decoded yet.

        The place of that node is unknown. But its landmark lies in the middle of a cell of the node's offset.
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
        """Return the indices of known landmarks at the place of a claim."""
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
            shapes, more = search.empty_shapes(), []
            locks = [lock for node in nodes for lock in self._locks(state, node)]
            asked = [(lock.hint.shape, self.mission.nodes[lock.node].reach_dm) for lock in locks]
        # If several runs of shapes are packed, other shapes come between them, and tries must be counted in that order.
        return None if more else search_target_of(self.config, chart, state.target, search.steps, shapes, asked)

    def look(self, state: State, seen: Experience) -> Find:
        """Search in an experience and return the result."""
        budget, keys = Budget(self.config.hash_tries if self._is_paper else self.config.kdf_tries), state.keys
        opened, fix, reason = None, None, Reason.NOTHING_SENSED
        failed: set[bytes] = set()
        unconfirmed: dict[Match, Opened] = {}
        again = self._again(state)
        for found in self._found(state, self._unexplained(state, seen, again), failed, budget):
            # Skip a match with the landmark of a known node, unless it is the same object: auditors check this too.
            same = self._same(state, found.claim) if again else frozenset()
            if again and found.seen not in (None, *self._unexplained(state, seen, same).landmarks):
                continue
            opened, fix, reason = self._believe(state, seen, found, unconfirmed)
            if opened is not None:
                break
        if opened is None and unconfirmed:
            opened, fix, reason = self._together(state, seen, unconfirmed)
        if opened is not None and opened.node not in state.opened:
            keys = replace(keys, tried=frozenset())  # a new node gives new gates, so other tries
        else:
            keys = keys.remember(failed, self.config.tried_limit)
        if reason is Reason.NOTHING_SENSED:
            reason = self.empty_find(state, seen, budget.used).reason
        return Find(keys, opened, fix, reason, budget.used)

    def empty_find(self, state: State, seen: Experience, tries: int) -> Find:
        """Return the result of a search that finds nothing."""
        reason = Reason.NOTHING_SENSED
        if tries or seen.landmarks or seen.sensors:
            most = self.config.hash_tries if self._is_paper else self.config.kdf_tries
            reason = Reason.BUDGET if tries >= most else Reason.NO_MATCH
        return Find(state.keys, None, None, reason, tries)

    def check(self, state: State, seen: Experience, claim: Claim) -> tuple[Opened, Fix | None]:
        """Check a robot's claim with one hash or KDF; return the opened node and the fix.

        Args:
            seen: made from the logged reading.
        Raises: Unshown: the node is not a candidate, the reading does not show it, or the claim does not open it.
            Altered: the mission file was changed.
        """
        clear = self._unexplained(state, seen, self._same(state, claim))
        if claim.node not in self.candidates(state):
            raise Unshown("the claimed node cannot be reached now")
        found = match_of_claim(self.mission, self.config, claim, clear, state.heard, self._released(state))
        if found is None:
            raise Unshown("the reading does not show the claimed observables")
        if (key := unlock(self.mission, claim)) is None:
            raise Unshown("the claim does not open the node")
        opened, fix, reason = self._believe(state, seen, replace(found, key=key))
        if opened is None:
            raise Unshown(f"the claim is rejected: {reason.value}")
        return opened, fix

    def chart(self, state: State) -> Chart:
        """Return the landmarks of decoded nodes."""
        return self._decoded(state.opened).chart

    def _unexplained(self, state: State, seen: Experience, again: Container[int] = ()) -> Experience:
        """Return the experience without landmarks that are too far away or belong to decoded nodes except the target.

        Args:
            again: indices of known landmarks to keep, as they may also be those of another node.
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
        """Return the hash of the last node, which chained nodes need (paper profile)."""
        if not self._is_paper or state.at is None:
            return b""
        return self.mission.nodes[state.at].aliases[state.opened[state.at].alias].mark

    def _locks(self, state: State, node: int) -> Iterator[Candidate]:
        """Yield the aliases of a sealed node whose gate the robot holds."""
        gate, hints = self._gate(state, node)
        record = self.mission.nodes[node]
        if gate is not None and len(hints) == len(record.aliases):
            for a, hint in enumerate(hints):
                yield Candidate(node, a, gate, hint)

    def keys_of(self, state: State, opened: Opened) -> Keyring:
        """Return the state's keyring with the proof and gates of a newly opened node."""
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
        """Return a node of a set of matches that is accepted only as a whole, with the common fix."""
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
        """Return the opened node of a match with its fix, or the reason to reject it.

        Args:
            unconfirmed: receives matches that may be accepted together with others.
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
        # Known landmarks in sight must agree.
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
    """Return True if a landmark is in the middle of its cell with a given offset."""
    x, y, _ = middle_of(coding, offset, cell_of(coding, offset, thing.x_m, thing.y_m))
    return length_m(thing.x_m - x, thing.y_m - y) <= MIDDLE_M
