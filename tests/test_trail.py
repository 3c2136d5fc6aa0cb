"""The trail: whole lines, room for each visitor, and an end that is not cut off unnoticed."""

from __future__ import annotations

import json
import logging
import os
from types import SimpleNamespace

import pytest

from phalanx.errors import UsageError
from phalanx.gateway import chain_file, trail
from phalanx.gateway.chain_file import LINE_BYTES, mark_of, read_lines, read_mark
from phalanx.gateway.trail import LINES_AT_ONCE, NEWCOMERS_AT_ONCE, Trail


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(trail, "time", SimpleNamespace(monotonic=lambda: now[0], time=lambda: 1.0))
    return now


@pytest.fixture
def path(tmp_path):
    return tmp_path / "trail.jsonl"


def events(path):
    return [line["event"] for line in read_lines(path)]


def test_it_adds_up_refusals_and_drives_and_goes_on_after_a_line_that_was_cut_off(path):
    kept = Trail(path)
    for n in range(1000):
        kept.refused(1, "AB", "late", 0.0)
        kept.drives(1, "AB", "move_raw", n / 100)
    kept.drives(2, "AB", "move_raw", 10.0)
    kept.tick(100.0)
    kept.close()
    lines = list(read_lines(path))
    assert [line["event"] for line in lines] == ["drives", "drove", "drives", "drove", "refused"]
    assert (lines[1]["commands"], lines[1]["visitor"], lines[4]["count"]) == (1000, 1, 1000)
    path.write_bytes(path.read_bytes() + b'{"at":1,"ev')
    with pytest.raises(UsageError, match="line 6 is incomplete"):
        list(read_lines(path))
    kept = Trail(path)
    kept.left(1)
    kept.close()
    assert events(path)[5:] == ["left"]
    assert {each.stat().st_mode & 0o777 for each in (path, mark_of(path))} == {0o600}


def test_a_visitor_without_end_takes_no_room_of_others_nor_of_operators(path, clock):
    kept = Trail(path)
    kept.joined(1, name="Ada")
    for n in range(500):
        kept.drives(2, f"R{n}", "move_raw", 0.0)
    for n in range(LINES_AT_ONCE - 1):
        kept.drives(1, f"A{n}", "move_raw", 10.0)
    for _ in range(200):
        kept.write("door", open=True, by=1)
    kept.tick(9.0)
    kept.tick(10.0)
    lines = list(read_lines(path))
    of = [line.get("visitor") for line in lines]
    assert of.count(1) == LINES_AT_ONCE
    assert sum(line["event"] == "door" for line in lines) == 200
    (left_out,) = [line for line in lines if line["event"] == "left_out"]
    assert left_out["visitors"][0] == 2
    assert left_out["lines"] >= 500 - LINES_AT_ONCE
    kept.close()


def test_newcomers_without_end_leave_room_for_who_is_here_and_are_counted(path, clock):
    kept = Trail(path)
    kept.joined(1, name="Ada")
    clock[0] = 3600.0
    kept.tick(3600.0)
    for n in range(2, NEWCOMERS_AT_ONCE + 500):
        kept.joined(n, name="")
        kept.left(n)
    kept.drives(1, "AB", "move_raw", 3600.0)
    kept.close()
    lines = list(read_lines(path))
    assert [line["visitor"] for line in lines if line["event"] == "drives"] == [1]
    written = sum("visitor" in line and line["visitor"] > 1 for line in lines)
    assert lines[-1]["event"] == "left_out"
    assert lines[-1]["lines"] == 2 * (NEWCOMERS_AT_ONCE + 498) - written
    assert written == 2 * NEWCOMERS_AT_ONCE


def test_a_stop_begins_and_ends_no_drive(path):
    kept = Trail(path)
    kept.drives(1, "AB", "move_raw", 0.0)
    for n in range(100):
        kept.stops(2, "AB", n / 10)
        kept.stops(1, "AB", n / 10)
        kept.drives(1, "AB", "move_raw", n / 10)
    kept.close()
    assert events(path) == ["drives", "drove", "stopped"]
    assert list(read_lines(path))[-1]["count"] == 100


def test_refusals_of_one_visitor_for_robots_that_it_makes_up_hide_no_others(path, clock):
    kept = Trail(path)
    for n in range(5000):
        kept.refused(1, f"R{n}", "not_allowed", 0.0)
    kept.refused(2, "AB", "late", 0.0)
    kept.close()
    lines = list(read_lines(path))
    assert sum(line["count"] for line in lines if line["visitor"] == 1) == 5000
    assert lines[-1]["visitor"] == 2


def test_no_line_is_longer_than_its_reader_takes_whatever_an_operator_does(path):
    kept = Trail(path)
    everybody = [4_294_967_295 - n for n in range(4096)]
    kept.write("everybody_out", visitors=everybody, by=0, durable=True)
    robots = [f"{n:064}" for n in range(1000)]
    kept.write("invited", robots=robots, name="\U0001f600" * 32, ticket="0" * 16, role="operate", uses=1000, by=1)
    kept.close()
    assert max(map(len, path.read_bytes().splitlines(keepends=True))) <= LINE_BYTES
    lines = list(read_lines(path))
    assert [each for line in lines for each in line.get("visitors", ())] == everybody
    assert [each for line in lines for each in line.get("robots", ())] == robots
    Trail(path).close()
    assert len(list(read_lines(path))) == len(lines)


@pytest.mark.parametrize("spoilt", [b"x" * 300_000, b"no trail\n", b'{"at":1}\n', b"[]\n", b"\xff\n"])
def test_a_damaged_trail_is_moved_aside_and_nothing_of_it_lost(path, spoilt, caplog):
    kept = Trail(path)
    kept.write("door", open=True, by=0)
    kept.close()
    path.write_bytes(path.read_bytes() + spoilt)
    before = path.read_bytes()
    with caplog.at_level(logging.WARNING):
        kept = Trail(path)
    kept.write("door", open=False, by=0)
    kept.close()
    (said,) = caplog.messages
    assert "started a new file" in said
    first, second = read_lines(path)
    assert (first["event"], second["event"]) == ("moved_aside", "door")
    assert (path.parent / first["file"]).read_bytes() == before


def test_the_next_start_records_that_the_end_was_cut_off(path, caplog):
    kept = Trail(path)
    for n in range(5):
        kept.write("door", open=True, by=n)
    kept.close()
    assert read_mark(path) == (path.stat().st_size, list(read_lines(path))[-1]["chain"])
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:3]))
    kept = Trail(path)
    kept.close()
    assert events(path) == ["door"] * 3 + ["cut_off"]
    assert "the end is missing or changed" in caplog.text
    Trail(path).close()
    assert len(events(path)) == 4


def test_a_kill_between_a_line_and_its_mark_is_no_cut(path):
    kept = Trail(path)
    kept.write("door", open=True, by=1)
    mark = mark_of(path).read_bytes()
    kept.write("door", open=True, by=2)
    mark_of(path).write_bytes(mark)
    kept.close()
    Trail(path).close()
    assert events(path) == ["door"] * 2


def test_a_disk_without_room_leaves_out_lines_says_so_and_breaks_no_chain(path, monkeypatch, caplog):
    kept = Trail(path)
    kept.write("door", open=True, by=1)
    monkeypatch.setattr(chain_file.os, "write", lambda file, line, write=os.write: write(file, line[: len(line) // 2]))
    for _ in range(10):
        kept.write("door", open=True, by=2)
    monkeypatch.undo()
    kept.write("door", open=True, by=3)
    kept.close()
    lines = list(read_lines(path))
    assert [line.get("by") for line in lines] == [1, 3, None]
    assert lines[-1]["lines"] == 10
    assert len(caplog.messages) == 1


def test_what_is_exported_is_a_trail_again(path, capsys):
    from phalanx.cli.invite import export, verify

    kept = Trail(path)
    kept.joined(1, name="Zoë\u202e")
    kept.close()
    export(path, None)
    copy = path.with_name("copy.jsonl")
    copy.write_text(capsys.readouterr().out)
    assert copy.read_bytes() == path.read_bytes()
    verify(copy, None, None)
    told = capsys.readouterr()
    assert told.out.startswith("1 line, complete")
    assert "not checked" in told.err
    verify(path, None, None)
    assert "not checked" not in capsys.readouterr().err
    for spoilt in (b"", json.dumps({"bytes": 5, "top": "a" * 64}).encode()):
        mark_of(path).write_bytes(spoilt)
        if spoilt:
            with pytest.raises(UsageError, match="was cut off"):
                verify(path, None, None)
        else:
            verify(path, None, None)
