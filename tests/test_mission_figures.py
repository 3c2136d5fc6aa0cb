"""The second shield's figures: what their tables promise, and small runs that must come out as the paper says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phalanx.crypto.sha3 import Targets, find, padded, sha3_256
from phalanx.errors import UsageError
from phalanx.lab.figures.plot import DRAWN_BY, draw, drawing
from phalanx.mission import Walker
from phalanx.papers.figure import FIGURES, Figure
from phalanx.papers.missions import fig8a as mission_fig8a
from phalanx.papers.missions import fig8c as mission_fig8c
from phalanx.papers.missions import fig10 as mission_fig10
from phalanx.papers.missions.drive import encoded, errors_m, record, replay
from phalanx.papers.missions.explore import FIG9, ROBOTS, TABLE1, ends, measure_case, shares_of
from phalanx.papers.statement import Statement, report
from phalanx.papers.table import Table, TableFile, measure, read_table
from phalanx.world.building.odometry import NoiseModel, OdometryNoise

ROWS = np.array([[1.5, 2.0], [np.nan, 4.0]])


def opened(path: Path, figure: str = "mission-figx", version: str = "1") -> TableFile:
    return TableFile(path, Table(figure=figure, columns=("a", "b"), origin={"version": version}))


def write(path: Path, *cases: str) -> None:
    with opened(path) as file:
        for case in cases:
            file.append(case, ROWS)


def test_a_table_that_is_read_again_has_what_was_written(tmp_path: Path) -> None:
    write(tmp_path / "x.csv", "seed 0", "fixed 3 m;0 0.05;seed 1")
    table = read_table(tmp_path / "x.csv")
    assert list(table.cases) == ["seed 0", "fixed 3 m;0 0.05;seed 1"]
    assert np.array_equal(table.cases["seed 0"], ROWS, equal_nan=True)
    assert table.column("seed 0", "b").tolist() == [2.0, 4.0]


@pytest.mark.parametrize("other", [{"figure": "mission-figy"}, {"version": "2"}])
def test_another_measurements_file_is_left_as_it_is(tmp_path: Path, other: dict[str, str]) -> None:
    path = tmp_path / "x.csv"
    write(path, "seed 0")
    before = path.read_bytes()
    with pytest.raises(UsageError), opened(path, **other):
        pass
    assert path.read_bytes() == before


@pytest.mark.parametrize("data", [b"a,b\n1,2\n", b"# phalanx x {}\n", b"\xff\xfe", b"# phalanx x {1}\ncase,a\n"])
def test_what_is_no_table_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.csv").write_bytes(data)
    with pytest.raises(UsageError):
        read_table(tmp_path / "x.csv")


def test_a_figure_goes_on_where_it_was_stopped_and_is_drawn_from_its_table_alone(tmp_path: Path, monkeypatch) -> None:
    measured: list[str] = []

    class Body:
        COLUMNS = ("a", "b")

        def cases(self, seeds: int) -> list[str]:
            return [f"seed {seed}" for seed in range(seeds)]

        def measure_case(self, case: str, _tell: object) -> np.ndarray:
            measured.append(case)
            if case == "seed 1" and measured.count(case) == 1:
                raise KeyboardInterrupt
            return ROWS

        def compare(self, table: Table) -> list[Statement]:
            return [Statement(what="rows", paper="", ours=str(len(table.cases)), agrees=True, why="")]

    def line(table: Table, picture) -> None:
        picture.subplots().plot(table.column("seed 0", "b"))

    monkeypatch.setitem(DRAWN_BY, "mission-figx", line)
    figure = Figure(name="mission-figx", about="a test", made_by=Body())
    with pytest.raises(KeyboardInterrupt):
        measure(tmp_path, figure, 2)
    csv = measure(tmp_path, figure, 2)
    assert measured == ["seed 0", "seed 1", "seed 1"]
    assert all(path.stat().st_size > 1000 for path in draw(csv, figure))
    told = report(figure, read_table(csv))
    assert (told.rows[0]["ours"], told.rows[0]["agrees"]) == ("2", None)
    assert told.lines[-1] == "no verdict with fewer than ten seeds: 2"
    measure(tmp_path, figure, 10)
    told = report(figure, read_table(csv))
    assert (told.rows[0]["ours"], told.rows[0]["agrees"]) == ("10", True)
    assert told.lines[-1] == "agrees: rows.  nothing differs"


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_made_by_something_that_can_measure_compare_and_draw(name: str) -> None:
    body = FIGURES[name].body
    assert callable(drawing(name))
    assert all(map(callable, (body.measure, body.report) if hasattr(body, "measure") else (body.cases, body.compare)))


def test_encoded_landmarks_correct_what_odometry_alone_loses() -> None:
    drive = record(0, duration_s=60.0)
    noise = OdometryNoise(0.03, 0.05, NoiseModel.FIXED)
    done = replay(drive, encoded(), noise, seed=0)
    assert errors_m(drive, done.odometry).max() > 0.8
    assert np.median(errors_m(drive, done.estimates)) < 0.05
    assert errors_m(drive, done.estimates).max() < 0.5


@pytest.mark.parametrize("sigma_t", [0.075, *(pytest.param(share, marks=pytest.mark.long) for share in (0.05, 0.06))])
def test_a_robot_that_learns_its_drift_falls_off_no_cliff_for_features_up_to_3_m(sigma_t: float) -> None:
    """The paper is lost from 6 % on; so were we, before odometry's errors were learnt from corrections."""
    drive, noise = record(0), OdometryNoise(sigma_t, 0.0, NoiseModel.FIXED)
    assert np.median(errors_m(drive, replay(drive, encoded(), noise, 0, 3.0).estimates)) <= 0.15


def test_the_plain_search_of_fig_8c_finds_what_the_compiled_one_finds() -> None:
    message, at = bytes(40), 18
    patches = np.arange(200, dtype=np.uint64)
    wanted = [sha3_256(message[:at] + int(k).to_bytes(8, "little") + message[at + 8 :]) for k in (150, 77)]
    targets, where = Targets(wanted).rows, (padded(message, at), at // 8, np.uint64(at % 8 * 8))
    for some, many in ((patches, 2), (patches[:77], 0), (patches[80:], 1)):
        assert mission_fig8c.plain_find(*where, some, targets) == find(*where, some, targets) != (-1, -1) or not many


def test_the_graph_is_divided_evenly_and_wholly_among_the_explorers() -> None:
    walker = Walker(encoded())
    shares = shares_of(walker)
    assert sorted(node for share in shares for node in share) == list(range(33))
    assert max(map(len, shares)) <= 9


@pytest.mark.long
def test_four_explorers_find_everything_and_none_sees_more_of_the_floor_than_the_papers() -> None:
    rows = measure_case("seed 0")
    table = Table("mission-fig9", {}, FIG9.COLUMNS, {"seed 0": rows})
    assert len(ends(rows)) == ROBOTS
    assert all(each.agrees for each in FIG9.compare(table))
    assert TABLE1.compare(table)[-1].agrees


def test_every_statement_of_a_short_drive_names_what_was_asked(tmp_path: Path) -> None:
    csv = measure(tmp_path, FIGURES["mission-fig8a"], 1)
    statements = mission_fig8a.compare(read_table(csv))
    assert all(each.what and each.ours and each.why for each in statements)
    assert all(each.agrees for each in statements)
    for path in draw(csv, FIGURES["mission-fig8a"]):
        assert path.exists()


def test_the_camera_office_has_23_codes_and_all_of_them_are_encoded() -> None:
    plan, mission = mission_fig10.office_with_codes()
    assert len(plan.codes) == 23
    assert len(mission.nodes) == 24
