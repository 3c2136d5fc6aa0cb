"""When nothing decodes: back, round, or stop; exploring, and replay."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from phalanx.config.mission import MissionConfig
from phalanx.errors import UsageError
from phalanx.mission import (
    Action,
    Draft,
    Experience,
    Kind,
    Landmark,
    Phase,
    Position,
    Profile,
    Reason,
    State,
    Walker,
)
from phalanx.mission.file.records import JOIN, parse_mission
from phalanx.mission.refused import Altered
from phalanx.mission.walk.state import TABLE, Event
from phalanx.mission.walk.state import step as next_phase
from worlds import (
    BOTH,
    CONFIG,
    at,
    at_start,
    built,
    cheap,
    corridor,
    explored,
    fork,
    until_decoded,
    walk,
    walker_for,
    walker_of,
)

both = pytest.mark.parametrize("profile", BOTH)


class TestFailSafe:
    @both
    def test_in_time_or_back_to_the_last_validated_node_and_round_the_other_way(self, profile):
        walker = walker_for(fork(), profile)
        state, outcome = walker.step(State(), Experience(0, 0, 0, 0))
        first = outcome.order.target
        other = 3 - first
        state, outcome = walker.step(state, Experience(4, 3, 0, 0, 3.0))
        assert outcome.order.kind is Kind.GO
        state, outcome = walker.step(state, Experience(5.1, 3, 0, 0, 3.0))
        assert (outcome.reason, outcome.order.kind, outcome.order.toward_m) == (Reason.TIMED_OUT, Kind.BACK, (0.0, 0.0))
        assert state.phase is Phase.RETURNING
        state, outcome = walker.step(state, Experience(6, 0.3, 0, 0, 6.0))
        assert (outcome.order.kind, outcome.order.target) == (Kind.GO, other)

    @both
    def test_a_blocked_way_is_left_out_until_none_is_left_and_then_tried_twice_more(self, profile):
        walker = walker_for(fork(), profile)
        state, outcome = walker.step(State(), Experience(0, 0, 0, 0))
        tried, aside = [], []
        for t_s in range(1, 4 * (1 + walker.config.rounds), 2):
            tried.append(state.target)
            aside.append(outcome.order.aside)
            state, outcome = walker.step(state, Experience(t_s, 2, 0, 0, 2.0, blocked=True))
            assert outcome.order.kind is Kind.BACK
            state, outcome = walker.step(state, Experience(t_s + 1, 0, 0, 0, 4.0))
        assert (outcome.order.kind, outcome.reason) == (Kind.HOLD, Reason.NO_WAY)
        assert sorted(tried) == [1, 1, 1, 2, 2, 2], "each again, twice, when none was left"
        assert aside == [0, 0, 1, 1, -1, -1], "on the line, to its left, to its right"
        state, outcome = walker.step(state, Experience(99, 4, 3, 0, 4.0, (Landmark("doorway", 4, 3, 0.2),)))
        assert outcome.reason is Reason.STOPPED, "nothing wakes a robot that holds"

    @pytest.mark.parametrize(
        ("corner", "degrees", "first"),
        [("concave_right", -90, -1), ("concave_right", 90, 1), ("concave_left", -90, 1), ("concave_left", 180, -1)],
    )
    def test_from_the_end_of_a_wall_the_side_where_nothing_is_comes_first(self, corner, degrees, first):
        """A face that looks north: its right end, for who stands before it, is the western one."""
        draft = Draft("around")
        draft.node("start", Position(0, 0), start=True)
        draft.node("end", Landmark(corner, 3, 0, math.pi / 2))
        turn = math.radians(degrees)
        draft.node("on", Landmark("doorway", 3 + 9 * math.cos(turn), 9 * math.sin(turn), 0.0), final=True)
        draft.way("start", "end")
        draft.way("end", "on")
        walker, state = at_start(draft, Profile.PAPER)
        seen = Experience(1, 2, 1, 0, 2.0, (Landmark(corner, 3, 0, math.pi / 2),))
        state, _ = until_decoded(walker, state, seen)
        asides = [walker.order(replace(state, round=i)).aside for i in range(3)]
        assert asides == [0, first, -first]

    @both
    def test_who_gets_on_counts_anew_which_ways_are_blocked_and_how_often(self, profile):
        walker = walker_for(fork(), profile)
        state, _ = walker.step(State(), Experience(0, 0, 0, 0))
        for t_s in (1, 3, 5):
            state, _ = walker.step(state, Experience(t_s, 2, 0, 0, 2.0, blocked=True))
            state, outcome = walker.step(state, Experience(t_s + 1, 0, 0, 0, 4.0))
        assert state.round == len(state.blocked) == 1
        assert outcome.order.kind is Kind.GO
        state, _ = until_decoded(walker, state, Experience(7, 3, 3, 0, 3.0, (Landmark("doorway", 4, 3, 0.2),)))
        assert (state.round, state.blocked) == (0, frozenset())

    def test_lost_on_the_way_back_too_it_holds(self):
        walker = walker_for(fork(), Profile.PAPER)
        state, _ = walker.step(State(), Experience(0, 0, 0, 0))
        for t_s, kind in ((5.1, Kind.BACK), (9, Kind.BACK), (10.3, Kind.HOLD)):
            state, outcome = walker.step(state, Experience(t_s, 7, 7, 0, t_s))
            assert outcome.order.kind is kind

    def test_who_never_validated_anything_holds_at_the_time_out(self):
        walker = walker_for(fork(), Profile.PAPER, replace(CONFIG, timeout_s=3))
        state, outcome = walker.step(State(), Experience(0, 30, 30, 0))
        assert (outcome.order.kind, outcome.reason) == (Kind.WAIT, Reason.NO_MATCH)
        state, outcome = walker.step(state, Experience(3.1, 30, 30, 0))
        assert (outcome.order.kind, outcome.reason) == (Kind.HOLD, Reason.TIMED_OUT)

    def test_a_clock_that_runs_backwards_or_is_none_changes_nothing(self):
        walker = walker_for(fork(), Profile.PAPER)
        state, _ = walker.step(State(), Experience(10, 0, 0, 0))
        for t_s in (9.0, math.nan):
            again, outcome = walker.step(state, Experience(t_s, 4, 3, 0, 4.0, (Landmark("doorway", 4, 3, 0.2),)))
            assert again is state
            assert outcome.reason is Reason.CLOCK

    def test_every_phase_but_the_last_two_has_a_way_on(self):
        assert {phase for phase, _ in TABLE} == {Phase.SEEKING, Phase.RETURNING}
        assert set(TABLE.values()) == set(Phase)
        assert {event for _, event in TABLE} == set(Event)
        assert next_phase(Phase.HELD, Event.DECODED) is Phase.HELD


class TestExploring:
    @both
    def test_a_known_node_is_passed_without_being_seen_again_by_who_knows_where_they_are(self, profile):
        draft = Draft("dead end")
        draft.node("start", Position(0, 0), start=True)
        doors = [Landmark("doorway", 4, 0, 0.1), Landmark("doorway", 4, 4, 0.4), Landmark("doorway", 9, 0, 0.7)]
        for i, door in enumerate(doors):
            draft.node(f"d{i}", door, do=Action("greet"))
        draft.way("start", "d0", both=True)
        for i in (1, 2):
            draft.way("d0", f"d{i}", both=True)
        walker, state = at_start(draft, profile)
        for i, (x, y) in enumerate([(3, 0), (4, 3)]):
            seen = Experience(1 + 10 * i, x, y, 0, 3.0 + 4 * i, (doors[i],), actions=(Action("greet"),))
            state, outcome = until_decoded(walker, state, seen)
            assert outcome.decoded.do == Action("greet")
        assert (state.at, state.target) == (2, 1), "d1 is a dead end: back to d0, which is known"
        far, _ = walker.step(state, Experience(20, 4, 0.2, 0, 10.0, spread=(0.16, 0.0, 0.0, 0.16, 0.0, 0.01)))
        assert far.at == 2, "who is unsure by 0.4 m has not passed it"
        state, outcome = walker.step(state, Experience(20, 4, 0.2, 0, 10.0))
        assert (state.at, state.target, outcome.decoded) == (1, 3, None), "and nothing is done there again"

    @both
    def test_a_bare_place_is_passed_by_who_is_less_sure_for_nothing_is_to_be_seen_there(self, profile):
        draft = Draft("between")
        draft.node("start", Position(0, 0), start=True)
        for i, x in enumerate((12, -12)):
            draft.node(f"d{i}", Landmark("doorway", x, 0, 0.1))
            draft.way("start", f"d{i}", both=True)
        walker, state = at_start(draft, profile)
        state, _ = until_decoded(walker, state, Experience(1, 9, 0, 0, 9.0, (Landmark("doorway", 12, 0, 0.1),)))
        assert (state.at, state.target) == (1, 0)
        lost, _ = walker.step(state, Experience(20, 0, 0.2, 0, 20.0, spread=(0.64, 0.0, 0.0, 0.16, 0.0, 0.01)))
        assert lost.at == 1, "who is unsure by 0.8 m is anywhere"
        state, _ = walker.step(state, Experience(20, 0, 0.2, 0, 20.0, spread=(0.36, 0.0, 0.0, 0.16, 0.0, 0.01)))
        assert (state.at, state.target) == (0, 2), "who is unsure by 0.6 m goes on"

    @both
    def test_without_a_final_node_all_are_visited_the_nearest_first_and_then_it_is_done(self, profile):
        draft = Draft("explore")
        draft.node("start", Position(0, 0), start=True)
        for i, (x, y) in enumerate([(4, 0), (8, 0), (4, 4)]):
            draft.node(f"d{i}", Landmark("doorway", x, y, 0.1 * i))
        for a, b in (("start", "d0"), ("d0", "d1"), ("d0", "d2")):
            draft.way(a, b, both=True)
        mission = cheap(draft.mission(), profile)
        steps = list(explored(mission, walker_of(built(mission, profile))))
        state, outcome = steps[-1]
        path = [o.decoded.node for _, o in steps if o.decoded]
        assert outcome.order.kind is Kind.DONE
        assert sorted(set(path)) == [0, 1, 2, 3]
        assert path[:2] == [0, 1]
        assert state.lengths_m[0, 1] == pytest.approx(4.0)

    @both
    def test_robots_that_meet_share_where_they_were_and_go_elsewhere(self, profile):
        draft = fork()
        draft.nodes[-1] = replace(draft.nodes[-1], final=False)
        walker = walker_for(draft, profile)
        there, _ = walker.step(State(), Experience(0, 0, 0, 0))
        left = Landmark("doorway", 4, 3, 0.2)
        there, outcome = until_decoded(walker, there, Experience(1, 3, 3, 0, 3.0, (left,)))
        report = walker.report(there)
        assert [node for node, _ in report] == [0, 1]
        here = walker.accept_report(State(), (*report, (99, bytes(32)), (-1, b"")))
        assert here.others == {0, 1}
        _, outcome = walker.step(here, Experience(0, 0, 0, 0))
        assert outcome.order.target == 2
        if profile is Profile.SEALED:
            lies = walker.accept_report(State(), ((1, bytes(32)), (2, report[1][1])))
            assert lies.others == frozenset()

    @both
    def test_it_is_not_done_while_a_node_is_dark_whatever_became_of_the_way_there(self, profile):
        """One bit, JOIN of the fourth node, shuts it for ever; and an author may forget a way."""
        draft = Draft("five")
        draft.node("start", Position(0, 0), start=True)
        for i in range(1, 5):
            draft.node(f"d{i}", Landmark("doorway", 4 * i, 0, 0.1 * i))
        for a, b in (("start", "d1"), ("d1", "d2"), ("d2", "d3"), ("d3", "start"), ("d2", "d4"), ("d4", "d2")):
            draft.way(a, b)
        whole = cheap(draft.mission(), profile)
        island = replace(whole, ways=tuple(way for way in whole.ways if way.target != "d3"))
        one = built(whole, profile)
        nodes = [replace(node, flags=node.flags ^ JOIN * (i == 3)) for i, node in enumerate(one.mission.nodes)]
        raw = replace(one.mission, nodes=tuple(nodes)).encode()
        assert sum((a ^ b).bit_count() for a, b in zip(raw, one.mission.encode(), strict=True)) == 1
        for walker, end in (
            (walker_of(one), Phase.DONE),
            (walker_of(replace(one, mission=parse_mission(raw))), Phase.HELD),
            (walker_of(built(island, profile)), Phase.HELD),
        ):
            *_, (state, outcome) = explored(whole, walker)
            assert state.phase is end
            assert sorted(state.opened) == ([0, 1, 2, 3, 4] if end is Phase.DONE else [0, 1, 2, 4])
            assert outcome.reason is (None if end is Phase.DONE else Reason.NO_WAY)

    @both
    def test_what_others_proved_to_have_decoded_need_not_be_reached_and_a_word_proves_nothing(self, profile):
        draft = Draft("two ways")
        draft.node("start", Position(0, 0), start=True)
        for i, y in enumerate((3, -3)):
            draft.node(f"d{i}", Landmark("doorway", 4, y, 0.3 * i))
            draft.way("start", f"d{i}")
        walker, begun = at_start(draft, profile)
        ends = [
            until_decoded(walker, begun, Experience(1, 3, y, 0, 3.0, (Landmark("doorway", 4, y, 0.3 * i),)))[0]
            for i, y in enumerate((3, -3))
        ]
        assert {state.phase for state in ends} == {Phase.HELD}
        for report, proven in ((walker.report(ends[1]), profile is Profile.SEALED), (((2, bytes(32)),), False)):
            told = walker.accept_report(begun, report)
            seen = Experience(1, 3, 3, 0, 3.0, (Landmark("doorway", 4, 3, 0.0),))
            state, _ = until_decoded(walker, told, seen)
            assert state.phase is (Phase.DONE if proven else Phase.HELD)


class TestReplay:
    @both
    def test_the_same_experiences_give_the_same_again_whatever_was_walked_before(self, profile):
        mission = cheap(corridor(5), profile)
        one = built(mission, profile)
        used, fresh = walker_of(one), Walker(parse_mission(one.mission.encode()), one.key, CONFIG)
        list(walk(mission, used))
        states = [list(walk(mission, walker)) for walker in (used, fresh)]
        assert states[0] == states[1]

    @both
    def test_a_walk_goes_on_from_any_state(self, profile):
        mission = cheap(corridor(4), profile)
        walker = walker_of(built(mission, profile))
        steps = list(walk(mission, walker))
        seen = at(mission, 8.0, 0.5, 1e3)
        for state, _ in steps[::5]:
            assert walker.step(state, seen) == walker.step(state, seen)

    def test_a_start_key_of_another_mission_is_refused(self):
        one, other = (built(cheap(corridor(2), Profile.SEALED), Profile.SEALED, seed) for seed in (1, 2))
        with pytest.raises(Altered):
            Walker(one.mission, other.key)
        with pytest.raises(UsageError, match="start key"):
            Walker(one.mission)
        opened = built(cheap(corridor(2), Profile.SEALED), Profile.SEALED, open_start=True)
        assert Walker(opened.mission).step(State(), Experience(0, 0, 0, 0))[1].decoded
        assert repr(one.key) == "<StartKey>", "secrets do not print"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("what", ["x_m", "y_m", "heading_rad", "travelled_m"])
@both
def test_an_estimate_that_is_no_number_validates_nothing_and_breaks_nothing(profile, what, bad):
    walker = walker_for(fork(), profile, MissionConfig())
    state, _ = walker.step(State(), Experience(0, 0, 0, 0))
    left = (Landmark("doorway", 4, 3, 0.2), Landmark("doorway", 9e5, -9e5, 0.2))
    state, outcome = walker.step(state, replace(Experience(1, 3, 3, 0, 3.0, left), **{what: bad}))
    assert what == "travelled_m" or outcome.decoded is None
    state, outcome = walker.step(state, Experience(99, 3, 3, 0, 3.0))
    assert outcome.reason is Reason.TIMED_OUT


def test_the_page_has_the_table_and_the_reasons():
    page = (Path(__file__).parents[2] / "docs" / "spec" / "mission.md").read_text()
    rows = re.findall(r"^\| ([a-z ]+) \| ([a-z ]+) \| ([a-z ]+) \|$", page, re.MULTILINE)
    table = {(phase.value, event.value): after.value for (phase, event), after in TABLE.items()}
    assert {(a, b): c for a, b, c in rows if a in {phase.value for phase in Phase}} == table
    for reason in Reason:
        assert re.search(rf"^\| {reason.value} \| ", page, re.MULTILINE), reason
