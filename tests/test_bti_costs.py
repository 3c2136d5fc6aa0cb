"""bti-fig5, bti-table1 and bti-table2: from counted instructions to what the paper says, and drawn."""

from __future__ import annotations

import pytest

from phalanx.lab.figures.plot import draw
from phalanx.papers.bti import loads
from phalanx.papers.figure import FIGURES
from phalanx.papers.statement import report
from phalanx.papers.table import measure, read_table


@pytest.fixture
def figure(request, tmp_path):
    made = FIGURES[request.param]
    csv = measure(tmp_path, made, 10)
    return made, csv, report(made, read_table(csv)).rows


@pytest.mark.parametrize("figure", ["bti-fig5"], indirect=True)
def test_fig5_has_the_paper_s_two_points_and_this_machine_s_times(figure):
    made, csv, (mac, hashed, *host) = figure
    assert (mac["paper"], mac["agrees"], hashed["paper"], hashed["agrees"]) == ("5.36", True, "0.144", False)
    cycles = loads.instructions("cortex-m3", "mac", "39")
    assert mac["ours"].startswith(f"{cycles / 50e3:.3f} Cortex-M3")
    assert all(float(row["ours"].split()[0]) > 0 for row in host)
    assert all(path.stat().st_size > 10_000 for path in draw(csv, made))


@pytest.mark.parametrize("figure", ["bti-table1", "bti-table2"], indirect=True)
def test_tables_have_each_call_and_their_sum(figure):
    made, csv, (*calls, every) = figure
    paper = {"bti-table1": 17.28, "bti-table2": 5.99}[made.name]
    sealed = [row for row in calls if "ealed" in row["what"]]
    if sealed:
        *radio, with_seals = sealed
        instead = [row for row in calls if "Wireless" not in row["what"] and row is not with_seals]
        first = [float(row["ours"].split()[0]) for row in instead]
        assert (len(radio), with_seals["paper"]) == (4, every["paper"])
        assert sum(first) == pytest.approx(float(with_seals["ours"].split()[0]), abs=0.005 * (len(first) + 1))
    calls = [row for row in calls if row not in sealed]
    assert float(every["paper"]) == pytest.approx(paper, abs=0.005) == sum(float(row["paper"]) for row in calls)
    first = [float(row["ours"].split()[0]) for row in (*calls, every)]
    assert sum(first[:-1]) == pytest.approx(first[-1], abs=0.005 * len(first))
    assert (every["agrees"], every["asked"]) == (True, "not worse")
    assert all(path.stat().st_size > 10_000 for path in draw(csv, made))


def test_a_load_is_time_on_the_bus_and_instructions_so_and_so_often():
    call = loads.Call("issueToken", 2.5, 54, 8, 21.0, 5.25)
    assert call.bus_ms == pytest.approx((54 + 8 + 16) * 10 / 2e6 * 1000)
    table = loads.Loads((call,))
    rows = table.measure_case("issueToken", lambda _share: None)[0]
    assert rows[2] == loads.instructions("cortex-m3", "calls", "issueToken")
