"""Planning: what is nearest is found without a look at the rest, and is what a look at all would find."""

from __future__ import annotations

from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st

from phalanx.mission.file.records import FINAL, JOIN
from phalanx.mission.walk.route import Map

COUNT = 8
nodes = st.integers(0, COUNT - 1)
ways = st.tuples(nodes, nodes)


def nearest(graph: Map, at, opened, others, lengths_m, blocked) -> int | None:
    """As `Map.next_target`, by the distances of all."""
    metres, via = graph.distances(at, opened, lengths_m, blocked)
    dark = [node for node in range(COUNT) if node not in opened]
    missing = [node for join in graph.joins for node in graph.before[join] if node not in opened]
    sets = [graph.finals, missing] if graph.finals else [[node for node in dark if node not in others], dark]
    for wanted in sets:
        goals = [node for node in wanted if node in metres and node != at]
        if goals:
            node = min(goals, key=lambda goal: (metres[goal], goal))
            while via[node] != at:
                node = via[node]
            return node
    return None


@given(
    st.lists(
        st.tuples(st.lists(nodes, max_size=4), st.sampled_from([0, 0, FINAL, JOIN])), min_size=COUNT, max_size=COUNT
    ),
    nodes,
    st.sets(nodes),
    st.sets(nodes),
    st.dictionaries(ways, st.sampled_from([0.0, 1.0, 2.0, 2.5])),
    st.sets(ways),
)
def test_the_nearest_node_is_found_as_by_the_distances_of_all(drawn, at, opened, others, lengths_m, blocked):
    records = [
        SimpleNamespace(ways=[SimpleNamespace(target=to) for to in onward], flags=flags) for onward, flags in drawn
    ]
    graph = Map(SimpleNamespace(nodes=records))
    opened |= {at}
    where = at, opened, others, lengths_m, blocked
    assert graph.next_target(*where) == nearest(graph, *where)
