"""The table of missions: a row a run, none lived twice, and in buildings that chance drew nothing believed is false."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from types import ModuleType

import pytest

from commands import ROOT
from phalanx.errors import UsageError
from scripts import in_this_process


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import mission_completion

    return in_this_process(monkeypatch, mission_completion)


def called(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["mission_completion.py", *map(str, words)])
    return script.main()


def row(script: ModuleType, **more: object) -> object:
    empty = {field.name: "" if field.type == "str" else 0 for field in script.fields(script.Row)}
    return script.Row(**{**empty, "where": "here", "profile": "paper", "noise": "stage", **more})


@pytest.mark.long
def test_in_drawn_buildings_missions_are_whole_and_nothing_is_false(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    file = tmp_path / "runs" / "missions.csv"
    words = ("drawn:1", "drawn:21", "--people", "0,3", "--noise", "stage,fixed", "--csv", file)
    assert called(script, monkeypatch, *words) == 0
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    assert {(each["where"], each["noise"], each["people"], each["completed"]) for each in rows} == {
        (where, noise, people, "1")
        for where in ("drawn:1", "drawn:21")
        for noise in ("stage", "fixed")
        for people in ("0", "3")
    }
    assert {(each["false_fixes"], each["false_decodes"], each["denied"]) for each in rows} == {("0", "0", "")}
    table = capsys.readouterr().out.splitlines()[-4:]
    assert all("0 in 0" in line and "of  2" in line for line in table)
    # Nothing is lived twice, and what was not written to its end is lived again.
    before = file.read_text()
    file.write_text(before[:-20])
    assert called(script, monkeypatch, *words) == 0
    assert capsys.readouterr().out.startswith(
        f"1/1  {rows[-1]['where']} paper {rows[-1]['noise']} {rows[-1]['people']} people"
    )
    assert file.read_text().count("\n") == before.count("\n")
    assert called(script, monkeypatch, *words) == 0
    assert capsys.readouterr().out.startswith("\nwhere")


def test_a_false_fix_or_decode_fails_the_script(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    rows = {0: row(script, completed=1), 1: row(script, seed=1, false_decodes=2, end="timed out", pose_error_m=1.5)}
    monkeypatch.setattr(script, "lived", lambda case: rows[case.seed])
    file = tmp_path / "m.csv"
    assert called(script, monkeypatch, "here", "--csv", file) == 0
    assert called(script, monkeypatch, "here", "--seeds", 2, "--csv", file) == 1
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.split() == "here paper stage 0 1 of 2 0 in 0 2 in 1 1.50 m timed out 1".split()
    assert called(script, monkeypatch, "--table", "--csv", file) == 1


def test_ctrl_c_keeps_what_was_lived(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    def lived(case):
        if case.seed == 1:
            raise KeyboardInterrupt
        return row(script, seed=case.seed)

    monkeypatch.setattr(script, "lived", lived)
    file = tmp_path / "m.csv"
    called(script, monkeypatch, "here", "--seeds", 3, "--csv", file)
    assert "stopped; 2 of 3 runs are left" in capsys.readouterr().err
    assert len(file.read_text().splitlines()) == 2


def test_buildings_are_told_from_one_seed_to_another(script: ModuleType) -> None:
    names = list(script.wheres_of(["office_40x40", "drawn:3-5", "drawn:flat:0-1", "drawn:9"]))
    assert names == [
        "office_40x40", "drawn:3", "drawn:4", "drawn:5", "drawn:flat:0", "drawn:flat:1", "drawn:9",
    ]  # fmt: skip


@pytest.mark.parametrize("words", [("office", "--profile", "secret"), ("office", "--noise", "loud"), ("--people", "x")])
def test_what_makes_no_sense_is_refused_before_anything_is_lived(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: tuple[str, ...]
) -> None:
    file = tmp_path / "m.csv"
    assert called(script, monkeypatch, "office", *words, "--csv", file) == 2
    assert not file.exists()


def test_another_table_is_not_written_to(script: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text("a,b\n1,2\n")
    with pytest.raises(UsageError, match="not a table of missions"):
        script.kept(file)
    assert file.read_text() == "a,b\n1,2\n"


def test_a_building_without_a_mission_is_a_row_that_says_so(script: ModuleType) -> None:
    told = script.lived(script.Case("no_such_map", "paper", "stage", 0, 0))
    assert told.end.startswith("no mission: there is no map 'no_such_map'")
    assert not told.completed


def test_the_long_form_is_what_was_asked_for(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["mission_completion.py"])
    cases = script.cases_of(script.words())
    assert len(cases) == len(set(cases)) == 7 * 2 * 3 * 2 * 10 + 200
    for name in script.MAPS:
        assert (script.ELSEWHERE / f"{name}.yaml").exists() or (ROOT / f"src/phalanx/data/maps/{name}.yaml").exists()
