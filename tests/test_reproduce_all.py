"""`phalanx reproduce all`: one page, whatever one figure does; and the small form of a figure."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import dataclass, replace

import numpy as np
import pytest

from phalanx.cli import reproduce
from phalanx.errors import Unavailable
from phalanx.lab.figures.plot import DRAWN_BY
from phalanx.papers.figure import FIGURES, Figure
from phalanx.papers.statement import NOT_MEASURED, Statement, quantiles
from phalanx.papers.table import by_seed, read_table

WORDS = ("reproduce", "all", "--quick")


@dataclass
class Body:
    """A figure whose rows cost nothing."""

    value: float = 1.0
    fails: type[BaseException] | None = None
    COLUMNS = ("x",)
    cases = staticmethod(by_seed)

    def measure_case(self, case, tell):
        if self.fails:
            raise self.fails("no such luck")
        tell(1.0)
        return np.array([[self.value]])

    def compare(self, table):
        value = table.column("seed 0", "x")[0]
        return [Statement(what="x | y", paper="1", ours=f"{value:g}", agrees=value == 1, why="the same")]


def line(table, picture):
    picture.subplots().plot([0, table.column("seed 0", "x")[0]])


@pytest.fixture
def figures(monkeypatch):
    made = {
        name: Figure(name=name, about=f"about {name}", made_by=Body(value)) for name, value in zip("abc", (1, 2, 1))
    }
    monkeypatch.setattr(reproduce, "FIGURES", made)
    for name in made:
        monkeypatch.setitem(DRAWN_BY, name, line)
    return made


def test_two_seeds_are_figures_without_a_verdict(figures, phalanx, tmp_path):
    pytest.importorskip("matplotlib")
    code, out, err = phalanx(*WORDS, "--out", str(tmp_path), "--json")
    assert code == 0
    page = (tmp_path / "reproduction.md").read_text()
    assert "| x \\| y | 1 |   | 2 | - | the same |" in page
    assert "b: no verdict with fewer than ten seeds" in err
    assert [each["agree"] for each in json.loads(out)["figures"]] == [0, 0, 0]
    assert list(read_table(tmp_path / "a.csv").cases) == ["seed 0", "seed 1"], "quick is two seeds"


def test_the_page_has_each_figure_and_what_agrees_and_differs(figures, phalanx, tmp_path):
    pytest.importorskip("matplotlib")
    code, out, err = phalanx("reproduce", "all", "--out", str(tmp_path), "--json")
    assert code == 0
    page = (tmp_path / "reproduction.md").read_text()
    assert [line for line in page.splitlines() if line.startswith("## ")] == ["## a", "## b", "## c", "## Not measured"]
    assert "| x \\| y | 1 |   | 1 | agrees | the same |" in page
    assert "| x \\| y | 1 |   | 2 | **differs** | the same |" in page
    assert all((tmp_path / f"{name}.png").exists() and f"({name}.png)" in page for name in figures)
    assert all(what in page for what, _ in NOT_MEASURED)
    assert "b: agrees in 0 of 1; differs: x | y" in err
    assert [(each["figure"], each["agree"]) for each in json.loads(out)["figures"]] == [("a", 1), ("b", 0), ("c", 1)]


@pytest.mark.parametrize(
    "fails, told", [(Unavailable, "no such luck"), (ZeroDivisionError, "ZeroDivisionError: no such luck")]
)
def test_a_figure_that_fails_is_told_and_the_others_are_there(figures, phalanx, tmp_path, fails, told):
    pytest.importorskip("matplotlib")
    figures["b"] = replace(figures["b"], made_by=Body(2, fails))
    code, _, err = phalanx(*WORDS, "--out", str(tmp_path))
    assert code == 1
    assert "Traceback" not in err
    page = (tmp_path / "reproduction.md").read_text()
    assert f"| b | about b | not measured: {told} |" in page
    assert "| c | about c | no verdict with fewer than ten seeds |" in page


def test_after_ctrl_c_the_same_command_goes_on(figures, phalanx, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    body = Body(1)
    figures["b"] = replace(figures["b"], made_by=body)
    body.fails = KeyboardInterrupt
    code, _, err = phalanx(*WORDS, "--out", str(tmp_path))
    assert code == 1
    assert "stopped; 1 of 3 figures are in" in err
    assert "## b" not in (tmp_path / "reproduction.md").read_text()
    body.fails = None
    monkeypatch.setattr(figures["a"].body, "fails", AssertionError)  # it is there already
    code, _, _ = phalanx(*WORDS, "--out", str(tmp_path))
    assert code == 0
    assert "## c" in (tmp_path / "reproduction.md").read_text()


def test_sigterm_ends_it_with_a_line_as_ctrl_c_does(figures, phalanx, tmp_path):
    pytest.importorskip("matplotlib")
    body = Body(1)
    body.measure_case = lambda case, tell: os.kill(os.getpid(), signal.SIGTERM)
    figures["b"] = replace(figures["b"], made_by=body)
    code, _, err = phalanx(*WORDS, "--out", str(tmp_path))
    assert (code, "stopped; 1 of 3 figures are in" in err) == (1, True)


def test_quick_is_less_of_what_is_not_said():
    fig4, fig9 = FIGURES["link-fig4"], FIGURES["bti-fig9"]
    assert fig9.option_values({}) == {"seeds": 20}
    assert fig9.option_values({}, quick=True) == {"seeds": 2}
    assert fig9.option_values({"seeds": 5}, quick=True) == {"seeds": 5}
    assert fig4.option_values({}, quick=True) == {"broker": "mosquitto", "duration": 10.0}


def test_every_figure_makes_statements_for_the_page():
    assert all(callable(each.body.compare) for each in FIGURES.values())


def test_an_even_number_of_values_has_the_mean_of_the_middle_two_as_median():
    assert quantiles(np.array([6.98, 8.98]), ".2f") == "7.98 (6.98 … 8.98)"
    assert quantiles(np.array([np.inf, np.inf]), ".2f").startswith("inf")
