"""What the CSVs of all figures have in common: they grow, are cut off where they broke, and are one run's at a time."""

from __future__ import annotations

import resource
from contextlib import contextmanager

import numpy as np
import pytest

from phalanx.errors import Unavailable, UsageError
from phalanx.papers.link.fig4_table import Row, cells, head, packets
from phalanx.papers.table import Table, TableFile, read_table


class Lines:
    """A file of each kind: opened, given the n-th thing to keep, counted."""

    def open(self, path):
        begin = head(broker="mosquitto", interval_s=0.5, lost_after_s=10.0, version="1")
        return TableFile(path, begin, packets)

    def append(self, file, n):
        file.append_line(cells(Row(n, "plain", 1e9, "back", 1.5)))

    def count(self, path):
        return len(packets(read_table(path))["plain"])


class Cases:
    kept = None

    def open(self, path):
        return TableFile(path, Table(figure="mission-figx", columns=("a", "b"), origin={"version": "1"}))

    def append(self, file, n):
        file.append(f"seed {n}", np.array([[1.0, n], [2.0, 3.0]]), self.kept)

    def count(self, path):
        return len(read_table(path).cases)


class CasesOfWhichMoreIsKept(Cases):
    def __init__(self):
        self.kept = {"robots": 3, "compromised": [{"robot": 1}]}


EACH = pytest.mark.parametrize(
    "kind", [Lines(), Cases(), CasesOfWhichMoreIsKept()], ids=lambda kind: type(kind).__name__
)


def write(kind, path, *which):
    with kind.open(path) as file:
        for n in which:
            kind.append(file, n)
    return path.read_bytes()


@contextmanager
def no_file_longer_than(size):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@EACH
def test_wherever_it_was_cut_short_it_goes_on_to_the_same_bytes(tmp_path, kind):
    path = tmp_path / "deep" / "x.csv"
    whole = write(kind, path, 0, 1, 2)
    ends = [len(write(kind, tmp_path / f"{n}.csv", *range(n))) for n in range(4)]
    for size in range(len(whole) + 1):
        path.write_bytes(whole[:size])
        kept = max(0, sum(end <= size for end in ends) - 1)
        if size >= ends[0]:
            assert kind.count(path) == kept
            assert path.stat().st_size == size, "reading alters nothing"
            if not isinstance(kind, Lines):
                with kind.open(path) as file:
                    assert len(file.done) == kept
        assert write(kind, path, *range(kept, 3)) == whole
    assert kind.count(path) == 3


@EACH
def test_two_runs_do_not_write_to_one_file(tmp_path, kind):
    with kind.open(tmp_path / "x.csv"), pytest.raises(UsageError, match="another run"):
        kind.open(tmp_path / "x.csv").__enter__()
    write(kind, tmp_path / "x.csv", 0)
    assert kind.count(tmp_path / "x.csv") == 1, "once it is closed, the next may"


@EACH
def test_somebody_elses_file_is_refused_and_left_alone(tmp_path, kind):
    path = tmp_path / "x.csv"
    for data in (b"a,b\n1,2\n", b"my only copy, no newline", b"\xff\xfe\n", b"#" * 5000):
        path.write_bytes(data)
        with pytest.raises(UsageError) as refused:
            kind.open(path).__enter__()
        assert refused.value.hint
        assert path.read_bytes() == data


@EACH
def test_a_folder_that_cannot_be_made_and_a_missing_file_are_told(tmp_path, kind):
    (tmp_path / "file").touch()
    with pytest.raises(Unavailable, match="cannot write"):
        kind.open(tmp_path / "file" / "x.csv").__enter__()
    with pytest.raises(UsageError, match="no file"):
        kind.count(tmp_path / "nothing.csv")
    with pytest.raises(UsageError, match="is a folder"):
        kind.count(tmp_path)


@EACH
def test_a_full_disk_is_told_and_what_was_whole_is_kept(tmp_path, kind):
    path = tmp_path / "x.csv"
    two, one = len(write(kind, path, 0, 1)), len(write(kind, tmp_path / "1.csv", 0))
    path.unlink()
    with no_file_longer_than(two - 3), pytest.raises(Unavailable, match="cannot write"):
        write(kind, path, 0, 1)
    assert path.stat().st_size == two - 3
    assert kind.count(path) == 1
    assert len(write(kind, path)) == one
