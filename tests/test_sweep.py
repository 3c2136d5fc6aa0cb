"""`phalanx sweep`: every run once, whoever is killed meanwhile, and the same as if it ran alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from commands import PHALANX
from phalanx.errors import Unavailable, UsageError
from phalanx.lab.sweep import dealing
from phalanx.lab.sweep.dealing import cases_with_dask, run_job
from phalanx.lab.sweep.plan import read_sweep
from phalanx.lab.sweep.store import OUTCOME, Store, points
from phalanx.papers.figure import FIGURES, Figure
from phalanx.papers.table import read_table
from phalanx.scenarios.file import find_scenario
from phalanx.world import simulate

SMALL = """scenario: flock-12
seeds: 3
grid:
  duration_s: 2
  robots: [4, 6]
  attack: [none, "hijack:robot=2,at=1"]
"""
MINE = """
from phalanx.robot import Controller

class Mine(Controller):
    def encode(self): return b""
    def decode(self, encoding): pass
    def on_recv(self, t_ms, frame): pass
    def on_input(self, step, t_ms, reading):
        print("talk")
        return []
"""
# It holds a sweep where it is until somebody has been killed, however fast the machine.
WAITING = """
import time
from pathlib import Path
from phalanx.robot import Controller

class Waiting(Controller):
    def encode(self): return b""
    def decode(self, encoding): pass
    def on_recv(self, t_ms, frame): pass
    def on_input(self, step, t_ms, reading):
        time.sleep(0.02)  # or a worker would be given many runs at a time, and end none before one that waits
        while self.rob_id > 4 and step and not Path(GATE).exists():
            time.sleep(0.02)
        return []
"""


@pytest.fixture
def written(tmp_path):
    def written(text: str) -> Path:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return path

    return written


def rows_in(folder: Path) -> list[dict]:
    import pyarrow.parquet as pq

    return [row for part in sorted((folder / "runs").glob("*.parquet")) for row in pq.read_table(part).to_pylist()]


def each_once(folder: Path, count: int) -> list[dict]:
    rows = rows_in(folder)
    assert len(rows) == len({row["key"] for row in rows}) == count
    return rows


class TestPlan:
    def test_it_is_every_point_under_every_seed_and_each_has_a_key_of_its_own(self, written):
        sweep = read_sweep(written(SMALL))
        jobs = sweep.jobs
        assert len(jobs) == len({job.key for job in jobs}) == 12
        assert [job.scenario.seed for job in jobs[:4]] == [0, 1, 2, 0]
        assert {len(job.scenario.attacks) for job in jobs} == {0, 1}
        again = read_sweep(written(SMALL.replace("seeds: 3", "seeds: [2]"))).jobs
        assert {job.key for job in again} < {job.key for job in jobs}, "the same run is the same, whatever is beside it"

    def test_a_controller_that_was_changed_makes_other_runs(self, written, tmp_path):
        path = written("scenario: flock-12\ngrid: {controller: 'own.py:Mine'}\n")
        (tmp_path / "own.py").write_text(MINE)
        (before,) = read_sweep(path).jobs
        (tmp_path / "own.py").write_text(MINE + "\n")
        (after,) = read_sweep(path).jobs
        assert before.key != after.key

    def test_what_lies_in_a_section_can_be_varied(self, written):
        text = "scenario: [flock-12, bti-fig9]\ngrid:\n  radio.mcs: [2, 3]\n  bti.t_val_ms: 9000\n"
        jobs = read_sweep(written(text)).jobs
        assert [(job.scenario.name, job.scenario.radio.mcs) for job in jobs] == [
            ("flock-12", 2), ("flock-12", 3), ("bti-fig9", 2), ("bti-fig9", 3),
        ]  # fmt: skip
        assert {job.scenario.bti.t_val_ms for job in jobs} == {9000}

    @pytest.mark.parametrize(
        "text, told",
        [
            ("", "mine.yaml:1: the file is not a mapping"),
            ("- 1", "mine.yaml:1: the file is not a mapping"),
            ("seeds: 3", "mine.yaml:1: no scenario"),
            ("scenario: flock-12\nseed: 3", "mine.yaml:2: no 'seed' in a sweep"),
            ("scenario: flock-12\nseeds: [1, 1]", "mine.yaml:2: seeds is [1, 1]"),
            ("scenario: flock-12\nseeds: -1", "mine.yaml:2: seeds is -1"),
            ("scenario: flock-12\ngrid:\n  robot: [3]", "mine.yaml:3: a scenario has no setting 'robot'"),
            ("scenario: flock-12\ngrid:\n  robots: [four]", "mine.yaml:3: robots is 'four'"),
            ("scenario: flock-12\ngrid:\n  robots: [true]", "mine.yaml:3: robots is True"),
            ("scenario: flock-12\ngrid:\n  robots: [4, 4]", "mine.yaml:3: robots: a value twice"),
            ("scenario: flock-12\ngrid:\n  robots: []", "mine.yaml:3: robots: no values"),
            ("scenario: flock-12\nseeds: 1000000\ngrid:\n  robots: [4, 5]", "mine.yaml:3: 2000000 runs"),
            ("scenario: flock-12\ngrid: {robots: 4.5}", "at scenario flock-12, robots 4.5: robots is 4.5"),
            ("scenario: flock-12\ngrid: {attack: spof}", "at scenario flock-12, attack spof: no attack 'spof'"),
            ("scenario: flock-12\ngrid: {controller: wheels}", "no controller 'wheels'"),
            ("scenario: flok-12", "no scenario 'flok-12'"),
            ("scenario: flock-12\ngrid: {attack: 'no.py:Mine'}", "no file "),
            ("scenario: [", "mine.yaml:1"),
        ],
    )
    def test_a_mistake_is_one_line_with_its_place(self, written, text, told):
        with pytest.raises(UsageError) as wrong:
            list(read_sweep(written(text)).jobs)
        assert told in str(wrong.value)
        assert "\n" not in str(wrong.value)


class TestStore:
    def test_what_is_there_is_kept_once_and_a_torn_part_is_none(self, written, tmp_path):
        sweep = read_sweep(written(SMALL))
        jobs, row = sweep.jobs, dict.fromkeys(OUTCOME)
        with Store(tmp_path / "out", sweep, "1") as store:
            store.add(jobs[0], row)
            store.add(jobs[0], row)
            store.write()
            store.add(jobs[1], row)
        (tmp_path / "out" / "runs" / "part-00007.tmp").write_bytes(b"PAR1")
        with Store(tmp_path / "out", sweep, "1") as store:
            assert store.done == {jobs[0].key, jobs[1].key}
            store.add(jobs[2], row)
            store.add(jobs[1], row)
        assert [each["key"] for each in each_once(tmp_path / "out", 3)] == [job.key for job in jobs[:3]]
        assert not list((tmp_path / "out" / "runs").glob("*.tmp"))

    def test_it_is_one_sweep_s_and_one_writer_s(self, written, tmp_path):
        sweep = read_sweep(written(SMALL))
        other = read_sweep(written(SMALL.replace("robots", "f_max").replace("4, 6", "1, 2")))
        with Store(tmp_path / "out", other, "1"):  # nothing is made of it
            pass
        with Store(tmp_path / "out", sweep, "1") as store:
            with pytest.raises(UsageError, match="another sweep writes"), Store(tmp_path / "out", sweep, "1"):
                pass
            store.add(sweep.jobs[0], dict.fromkeys(OUTCOME))
        with pytest.raises(UsageError, match="other version"), Store(tmp_path / "out", sweep, "2"):
            pass
        with pytest.raises(UsageError, match="other axes"), Store(tmp_path / "out", other, "1"):
            pass

    def test_a_run_of_a_file_that_has_changed_since_is_told(self, written, tmp_path):
        (tmp_path / "nine.yaml").write_text("robots: 9\n")
        path = written("scenario: nine.yaml\nseeds: 2\n")
        with Store(tmp_path / "out", sweep := read_sweep(path), "1") as store:
            store.add(sweep.jobs[1], dict.fromkeys(OUTCOME))
        with Store(tmp_path / "out", read_sweep(path), "1") as store:
            assert store.done == {sweep.jobs[1].key}
        (tmp_path / "nine.yaml").write_text("robots: 8\n")
        with pytest.raises(UsageError) as wrong, Store(tmp_path / "out", read_sweep(path), "1"):
            pass
        assert "out has another run at scenario nine.yaml, seed 1: a file has changed since" in str(wrong.value)

    @pytest.mark.parametrize("cut", [slice(0, 900), slice(0, 4), slice(0, 0), slice(4, -8), slice(4, 400)])
    def test_a_damaged_part_is_told(self, written, tmp_path, cut):
        sweep = read_sweep(written(SMALL))
        with Store(tmp_path / "out", sweep, "1") as store:
            store.add(sweep.jobs[0], dict.fromkeys(OUTCOME))
        part = tmp_path / "out" / "runs" / "part-00000.parquet"
        data = bytearray(part.read_bytes())
        if cut.start:
            data[cut] = bytes(each ^ 0x5A for each in data[cut])
            part.write_bytes(data)
        else:
            part.write_bytes(data[cut])
        with pytest.raises(Unavailable) as damaged, Store(tmp_path / "out", sweep, "1") as store:
            list(store.rows())
        assert str(damaged.value) == f"{part} is damaged"

    @pytest.mark.parametrize("name", ["part-00001", "part-mine"])
    def test_somebody_elses_part_is_told(self, written, tmp_path, name):
        sweep = read_sweep(written(SMALL))
        with Store(tmp_path / "out", sweep, "1"):
            pass
        theirs = tmp_path / "out" / "runs" / f"{name}.parquet"
        parquet.write_table(pa.table({"key": ["mine"]}), theirs)
        with pytest.raises(UsageError) as wrong, Store(tmp_path / "out", sweep, "1"):
            pass
        assert str(wrong.value) == f"{theirs} is not part of this sweep"

    def test_a_row_is_what_the_run_alone_comes_to(self, written, tmp_path):
        sweep = read_sweep(written(SMALL))
        job = sweep.jobs[-1]
        row = run_job(job)
        assert set(row) == set(OUTCOME)
        alone = simulate(
            find_scenario("flock-12").with_options(robots=6, duration_s=2.0), attacks=job.scenario.attacks, seeds=[2]
        )
        (summary,) = alone.summaries
        assert (row["digest"], row["liars"]) == (summary["digest"], 1)
        with Store(tmp_path / "out", sweep, "1") as store:
            store.add(job, row)
            store.write()
            told = points(sweep, store.rows())
        assert [each["runs"] for each in told] == [0, 0, 0, 1]


def test_a_protocol_has_its_score_and_a_guard_its_numbers(written, tmp_path):
    sweep = read_sweep(written("scenario: exploration\ngrid:\n  duration_s: 2\n  guard.speed_mps: [1, 2]\n"))
    assert [job.scenario.guard.speed_mps for job in sweep.jobs] == [1, 2]
    (summary,) = simulate(sweep.jobs[0].scenario).summaries
    with Store(tmp_path / "out", sweep, "1") as store:
        store.add(sweep.jobs[0], run_job(sweep.jobs[0]))
        store.write()
        seen, nothing = points(sweep, store.rows())
    assert seen["score"] == summary["task"]["% seen"]
    assert nothing["score"] is None


def sweeping(path: Path, out: Path, *more: str) -> list[str]:
    return [*PHALANX, "sweep", str(path), "--out", str(out), *more]


def children_of(pid: int) -> set[int]:
    found = {int(stat.parent.name) for stat in Path("/proc").glob("[0-9]*/stat") if _parent(stat) == pid}
    return found | {each for child in found for each in children_of(child)}


def _parent(stat: Path) -> int:
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError):
        return 0


def workers_of(pid: int) -> set[int]:
    """Those that run, and not those that watch over them: the leaves."""
    return {each for each in children_of(pid) if not children_of(each) and _runs(each)}


def _runs(pid: int) -> bool:
    try:
        return b"forkserver" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def kills_or_doubles(job: tuple[int, bool]) -> int:
    number, kills = job
    if kills:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 7:
        raise ValueError("seven")
    return 2 * number


class TestCluster:
    LONGER = SMALL.replace("duration_s: 2", "duration_s: 10").replace("seeds: 3", "seeds: 400")

    def test_killed_workers_and_a_killed_command_lose_and_count_nothing_twice(self, written, tmp_path):
        gate, out = tmp_path / "gate", tmp_path / "out"
        (tmp_path / "own.py").write_text(WAITING.replace("GATE", repr(str(gate))))
        path = written(SMALL.replace("seeds: 3", "seeds: 4") + "  controller: 'own.py:Waiting'\n")
        going = subprocess.Popen(
            sweeping(path, out, "--workers", "2"),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        until = time.monotonic() + 120
        killed: set[int] = set()
        while len(killed) < 2 and going.poll() is None and time.monotonic() < until:
            if rows_in(out):  # they are at work
                for worker in sorted(workers_of(going.pid))[:1]:
                    os.kill(worker, signal.SIGKILL)
                    killed.add(worker)
            time.sleep(0.3)
        before = rows_in(out)
        os.killpg(going.pid, signal.SIGKILL)
        going.wait()
        assert len(killed) == 2
        assert 0 < len(before) < 16
        gate.touch()
        done = subprocess.run(
            sweeping(path, out, "--workers", "2", "--json"), capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        rows = each_once(out, 16)
        assert rows[: len(before)] == before, "nothing that was written is lost"
        told = json.loads(done.stdout)
        assert [point["runs"] for point in told["points"]] == [4] * 4
        one = next(row for row in rows if (row["robots"], row["attack"], row["seed"]) == (6, "none", 3))
        scenario = find_scenario("flock-12").with_options(robots=6, duration_s=2.0, attacks=(), seed=3)
        alone = simulate(scenario, controller=f"{tmp_path / 'own.py'}:Waiting")
        assert one["digest"] == alone.summaries[0]["digest"]

    @pytest.mark.long
    def test_sigterm_keeps_what_is_there_and_says_so_as_ctrl_c_does(self, written, tmp_path):
        path, out = written(self.LONGER), tmp_path / "out"
        going = subprocess.Popen(sweeping(path, out, "--workers", "1"), stderr=subprocess.PIPE, text=True)
        until = time.monotonic() + 120
        while not rows_in(out) and going.poll() is None and time.monotonic() < until:
            time.sleep(0.1)
        going.send_signal(signal.SIGTERM)
        _, said = going.communicate(timeout=60)
        assert going.returncode == 1
        assert "Traceback" not in said
        assert "leaked" not in said
        assert (
            f"stopped: {len(rows_in(out))} runs are in {out / 'runs'}; run the same command again to continue" in said
        )

    @pytest.mark.long
    def test_a_scheduler_that_there_is_runs_it_and_what_an_own_controller_prints_is_no_data(self, written, tmp_path):
        (tmp_path / "own.py").write_text(MINE)
        path = written("scenario: flock-12\nseeds: 2\ngrid: {controller: 'own.py:Mine', duration_s: 1, robots: 4}\n")
        script = (
            "import distributed, sys\n"
            "if __name__ == '__main__':\n"
            "    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:\n"
            "        print(cluster.scheduler_address, flush=True)\n"
            "        sys.stdin.read()\n"
        )
        (tmp_path / "cluster.py").write_text(script)
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen([sys.executable, str(tmp_path / "cluster.py")], text=True, **pipes) as cluster:
            address = cluster.stdout.readline().strip()
            words = sweeping(path, tmp_path / "out", "--scheduler", address, "--json")
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            cluster.stdin.close()
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["points"][0]["runs"] == 2
        each_once(tmp_path / "out", 2)

    def test_a_run_that_fails_is_named_and_the_others_are_kept(self, written, tmp_path, phalanx):
        raising = MINE.replace('print("talk")', "assert self.rob_id < 5, 'five is too many'")
        (tmp_path / "own.py").write_text(raising)
        path = written("scenario: flock-12\ngrid: {controller: 'own.py:Mine', duration_s: 1, robots: [4, 5]}\n")
        code, out, err = phalanx("sweep", str(path), "--out", str(tmp_path / "out"), "--workers", "1", "--json")
        assert code == 1
        (told,) = json.loads(out)["failed"]
        assert "robots 5" in told
        assert "own.py:9: AssertionError: five is too many" in told
        assert "Traceback" not in err
        each_once(tmp_path / "out", 1)

    def test_short_runs_share_a_task_and_the_one_that_kills_it_takes_no_other_with_it(self, monkeypatch):
        monkeypatch.setitem(dealing.SETTINGS, "distributed.scheduler.allowed-failures", 0)
        jobs = {f"job {i}": (i, i == 3) for i in range(12)}
        come = list(dealing.run_jobs(jobs, kills_or_doubles, None, 1))
        assert len(come) == len(dict(come)) == 12, "each once"
        failed = {key: told for key, told in come if isinstance(told, dealing.Failed)}
        assert failed.keys() == {"job 3", "job 7"}
        assert failed["job 7"].why == "ValueError: seven"
        assert "died" in failed["job 3"].why
        doubled = {key: told for key, told in come if key not in failed}
        assert doubled == {f"job {i}": 2 * i for i in range(12) if i not in (3, 7)}

    def test_no_scheduler_there_is_one_line(self, written, tmp_path, phalanx, monkeypatch):
        monkeypatch.setattr("phalanx.lab.sweep.dealing.CONNECT_S", 1.0)
        code, _, err = phalanx(
            "sweep", str(written(SMALL)), "--out", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"
        )
        assert code == 1
        assert err.splitlines()[-2] == "phalanx: error: no dask scheduler at tcp://127.0.0.1:9"
        code, _, _ = phalanx("sweep", str(written(SMALL)), "--scheduler", "tcp://127.0.0.1:9", "--workers", "2")
        assert code == 2

    def test_cases_of_a_figure_are_dealt_out_and_come_to_the_same(self, tmp_path, phalanx, monkeypatch):
        monkeypatch.setattr("phalanx.papers.table.version", lambda: "of a test")
        tables = []
        for words in (("--workers", "2"), ()):
            code, _, err = phalanx("reproduce", "bti-fig9", "--seeds", "1", "--out", str(tmp_path / str(words)), *words)
            assert code == 0, err
            tables.append(read_table(tmp_path / str(words) / "bti-fig9.csv", "bti-fig9"))
        dealt, alone = tables
        assert dealt.cases.keys() == alone.cases.keys() == {"honest seed 0", "attacked seed 0"}
        assert all((dealt.cases[case] == alone.cases[case]).all() for case in alone.cases)
        assert dealt.kept == alone.kept

    def test_a_case_that_cannot_be_measured_leaves_the_others(self, tmp_path):
        figure = Figure(name="of-nothing", about="a test", made_by="bti.liars:FIG9")
        each, told = cases_with_dask(None, 1), []
        with pytest.raises(Unavailable, match="1 of 2 failed, as no such case: ValueError"):
            told.extend(each(figure, ["no such case", "honest seed 0"], print))
        assert [case for case, _ in told] == ["honest seed 0"]

    @pytest.mark.parametrize("figure", [name for name, each in FIGURES.items() if each.alone])
    def test_what_times_something_is_measured_here_alone(self, figure, phalanx):
        code, _, err = phalanx("reproduce", figure, "--workers", "2")
        assert code == 2
        assert "--workers" in err
