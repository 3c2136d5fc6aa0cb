"""Controllers of one's own that are compiled: the same bytes as uncompiled, the cache, mistakes with file and line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from commands import ROOT
from phalanx.errors import KernelDefect, OutsideSubset, OwnDefect, UsageError
from phalanx.lab.determinism import check
from phalanx.lab.sweep.dealing import run_sweep
from phalanx.lab.sweep.plan import read_sweep
from phalanx.lab.sweep.store import Store
from phalanx.robot.controllers import dispatch, own_kernels
from phalanx.robot.controllers.declaration import OWN
from phalanx.scenarios.own import find_controller
from phalanx.world import Scenario, simulate
from phalanx.world.scenarios.run import Run
from phalanx_compiler import library as building

EXAMPLE = ROOT / "examples" / "own_kernels.py"
FLOCK = ROOT / "src" / "phalanx" / "robot" / "controllers" / "bundled" / "flock.py"
SMALL = Scenario(robots=6, duration_s=4.0)
QUICK = ("--duration", "2", "--robots", "6")
# What violations of results say.
LENGTH = r"length -?\d+ of a row of \d+ bytes$"
OUTPUTS = r"length -?\d+ of a row of \d+ bytes: no valid outputs end there$"
# A command behind a packet.
ACT_AGAIN = """        end = begin + table.STATE.size
        begin = put_head(out, end, table.ENTRY_ACMD, table.ACCELERATION.size, table.KIND_ACCELERATION, rob_id, t_ms)
        end = begin + table.ACCELERATION.size
"""
RUN = """
import sys
from phalanx.world import Scenario, simulate
print(simulate(Scenario(robots=6, duration_s=4.0), controller=sys.argv[1]).summaries[0]["digest"])
"""


@pytest.fixture(autouse=True)
def _apart(tmp_path, monkeypatch):
    """A cache, a working folder and names of controllers for each test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(own_kernels, "_loaded", {})
    monkeypatch.setattr(own_kernels, "_files", {})
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.chdir(tmp_path)
    yield
    for name in list(OWN):
        del OWN[name], dispatch.BUNDLED[name], dispatch.NUMBERS[name]


@pytest.fixture
def mine(tmp_path):
    """Return what writes a file mine.py: the example, with other words at some places."""

    def write(*changes: tuple[str, str], name: str = "mine.py") -> str:
        text = EXAMPLE.read_text()
        for was, becomes in changes:
            assert text.count(was) == 1, was
            text = text.replace(was, becomes)
        (tmp_path / name).write_text(text)
        return name

    return write


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CC", "none-such")


def digest(controller: str | None, scenario: Scenario = SMALL) -> str:
    return simulate(scenario, controller=controller).summaries[0]["digest"]


def in_new_process(controller: str, **env: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", RUN, controller]
    return subprocess.Popen(words, env=os.environ | env, stdout=-1, stderr=-1, text=True)


def libraries(tmp_path: Path) -> list[Path]:
    folder = tmp_path / "cache" / "phalanx" / "controllers"
    assert not list(folder.glob("*.tmp"))
    return list(folder.iterdir())


def line_of(words: str, file: str = "mine.py") -> int:
    return next(n for n, line in enumerate(Path(file).read_text().splitlines(), 1) if words in line)


class TestCompiled:
    def test_it_flies_as_uncompiled_to_the_byte(self, mine, caplog):
        compiled = digest(mine())
        assert not caplog.records
        pure = in_new_process("mine.py", PHALANX_PURE="1")
        called_back = in_new_process("mine.py", CC="none-such", XDG_CACHE_HOME=str(Path.cwd()))
        for process in (pure, called_back):
            out, err = process.communicate()
            assert out.strip() == compiled, err
        assert "mine.py runs uncompiled" in err

    def test_the_bundled_flock_as_a_file_flies_as_the_bundled_one(self):
        shutil.copy(FLOCK, "mine.py")
        assert digest("mine.py") == digest(None)

    @pytest.mark.skipif(not shutil.which("clang"), reason="clang is not installed")
    def test_another_compiler_gives_the_same(self, mine, tmp_path):
        compiled = digest(mine())
        assert in_new_process("mine.py", CC="clang -O1").communicate() == (f"{compiled}\n", "")
        assert len(libraries(tmp_path)) == 2

    def test_its_folder_is_the_users_alone(self, mine, tmp_path):
        digest(mine())
        assert (tmp_path / "cache" / "phalanx" / "controllers").stat().st_mode & 0o777 == 0o700
        assert len(libraries(tmp_path)) == 1

    def test_the_second_time_needs_no_compiler(self, mine, tmp_path):
        compiled = digest(mine())
        process = in_new_process("mine.py", CC="none-such")
        assert process.communicate() == (f"{compiled}\n", "")
        assert len(libraries(tmp_path)) == 1

    def test_a_changed_file_is_compiled_anew(self, mine, tmp_path):
        before = digest(mine())
        assert digest(mine(("LIMIT_MPS2 = 5000, 4.0", "LIMIT_MPS2 = 5000, 0.5"))) != before
        assert len(libraries(tmp_path)) == 2
        assert digest(mine()) == before
        assert len(libraries(tmp_path)) == 2

    def test_what_is_not_a_library_in_the_cache_is_made_anew(self, mine, tmp_path, monkeypatch):
        before = digest(mine())
        (library,) = libraries(tmp_path)
        library.chmod(0o777)  # somebody may have written to it
        monkeypatch.setattr(own_kernels, "_loaded", {})
        monkeypatch.setattr(own_kernels, "_files", {})
        assert digest("mine.py") == before
        assert libraries(tmp_path)[0].stat().st_mode & 0o777 == 0o700

    @pytest.mark.parametrize("compiler", ["cc", "none-such"])
    def test_a_library_that_cannot_be_loaded_is_compiled_again(self, mine, tmp_path, monkeypatch, caplog, compiler):
        words = mine()
        pure = in_new_process(words, PHALANX_PURE="1").communicate()[0].strip()
        assert in_new_process(words).communicate() == (f"{pure}\n", "")
        (library,) = libraries(tmp_path)
        library.write_bytes(library.read_bytes()[:100])
        monkeypatch.setenv("CC", compiler)
        assert digest(words) == pure
        assert f"{library}: " in caplog.messages[0]
        assert "compiling it again" in caplog.messages[0]
        sizes = [each.stat().st_size for each in libraries(tmp_path)]
        assert len(sizes) == (compiler == "cc")
        assert all(each > 1000 for each in sizes)

    def test_many_processes_that_compile_at_once_all_run(self, mine, tmp_path):
        mine()
        said = [process.communicate() for process in [in_new_process("mine.py") for _ in range(3)]]
        assert len({out for out, _ in said}) == 1
        assert {err for _, err in said} == {""}
        assert len(libraries(tmp_path)) == 1

    def test_two_files_fly_at_once(self, mine):
        mine()
        mine(("LIMIT_MPS2 = 5000, 4.0", "LIMIT_MPS2 = 5000, 0.5"), name="other.py")
        alone = {name: digest(name) for name in ("mine.py", "other.py")}
        runs = {name: Run(find_controller(name, SMALL)[0]) for name in alone}
        for second in range(1, 5):
            for run in runs.values():
                run.advance(second)
        assert {name: run.summary()["digest"] for name, run in runs.items()} == alone
        assert alone["mine.py"] != alone["other.py"]

    def test_what_is_made_for_one_robot_in_python_flies_the_same(self, mine):
        scenario, made = find_controller(mine(), SMALL, in_python=True)
        assert scenario is SMALL
        runs = [simulate(SMALL, controller=each) for each in (made, "mine.py")]
        np.testing.assert_array_equal(runs[0].positions_m, runs[1].positions_m)
        assert runs[0].summaries[0]["bytes_per_s_per_robot"] == runs[1].summaries[0]["bytes_per_s_per_robot"]

    def test_it_has_room_for_what_it_remembers(self, mine):
        changes = ("PLACES, EACH = 16, table", "PLACES, EACH = 256, table")
        assert digest(mine(changes)) != ""

    def test_forked_workers_run_it(self, mine):
        together = simulate(SMALL, controller=mine(), seeds=range(3), workers=2)
        alone = simulate(SMALL, controller="mine.py", seeds=range(3))
        assert [each["digest"] for each in together.summaries] == [each["digest"] for each in alone.summaries]

    def test_a_sweeps_processes_run_it(self, mine, tmp_path):
        mine()
        Path("sweep.yaml").write_text(
            "scenario: flock-12\nseeds: 2\ngrid:\n  controller: [mine.py, flock]\n  duration_s: [2]\n"
        )
        sweep = read_sweep(Path("sweep.yaml"))
        with Store(tmp_path / "out", sweep, "") as store:
            assert run_sweep(sweep, store, workers=2) == []


class TestAudited:
    def test_a_liar_is_stopped_and_nobody_else(self, mine):
        scenario = Scenario(robots=9, duration_s=25.0).with_options(f_max=2)
        (told,) = simulate(scenario, controller=mine(), attacks="equivocate:robot=5,at=8").summaries
        (liar,) = told["compromised"]
        assert liar["safe_mode_s"] - liar["first_deviation_s"] < 10.2
        assert told["correct_in_safe_mode"] == told["without_quorum"] == []

    def test_the_example_stops_its_liar_and_nobody_else(self):
        child = subprocess.run([sys.executable, EXAMPLE], capture_output=True, text=True, check=True)
        lied, stopped, _ = child.stdout.splitlines()
        assert lied.startswith("robot 5 lied from 10.0 s on, Safe Mode at 1")
        assert stopped == "honest robots stopped: [], for want of a quorum: []"

    def test_attack_run_tries_it(self, phalanx, mine):
        code, out, err = phalanx("attack", "run", "hijack:robot=2,at=1", *QUICK, "--controller", mine())
        assert code == 0, err
        assert "distance to the goal" not in out, "that of the scenario, not of this controller"

    def test_sim_check_finds_nothing(self, phalanx, monkeypatch):
        monkeypatch.setattr(check, "OTHERS", 1)  # one other process tells
        code, out, err = phalanx("sim", "check", str(EXAMPLE))
        assert code == 0, out + err


class TestWithoutACompiler:
    @pytest.mark.usefixtures("no_compiler")
    def test_a_line_tells_what_to_install(self, phalanx, mine):
        code, _, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", mine())
        assert code == 0
        (line,) = [each for each in err.splitlines() if "warning" in each]
        assert line.endswith(
            "mine.py runs uncompiled, many times slower: CC=none-such: command not found; "
            "install gcc or clang, or name one in CC"
        )

    def test_a_compiler_that_fails_is_none(self, mine, monkeypatch, caplog, tmp_path):
        compiled = digest(mine())
        monkeypatch.setattr(own_kernels, "_loaded", {})
        monkeypatch.setattr(own_kernels, "_files", {})
        monkeypatch.setenv("CC", "false")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))
        assert digest("mine.py") == compiled
        assert "false: it fails" in caplog.text

    def test_none_at_all(self, monkeypatch, tmp_path):
        monkeypatch.setenv("PATH", str(tmp_path))
        with pytest.raises(building.NoCompiler, match="there is no C compiler"):
            building.find_compiler()

    @pytest.mark.usefixtures("no_compiler")
    def test_a_violation_names_the_file_and_the_line(self, mine):
        words = mine(("    ax, ay = 0.0, 0.0\n    if", "    ax, ay = 0.0, 1.0 * (step // (step - step))\n    if"))
        with pytest.raises(OwnDefect, match=rf"^mine.py:{line_of('step - step')}: ZeroDivisionError: "):
            digest(words)

    def test_ctrl_c_gets_through_compiled_code(self):
        def stop(*_):
            raise KeyboardInterrupt

        plain = dict.fromkeys(dispatch.DECLARED, stop)
        number = dispatch.add_own(plain, {name: own_kernels._callback(name, stop) for name in plain})
        with pytest.raises(KeyboardInterrupt):
            dispatch.size(number, np.zeros(3, np.uint8))


class TestCache:
    def refused(self, words: str) -> str:
        with pytest.raises(UsageError) as refused:
            digest(words)
        assert refused.value.hint
        return str(refused.value)

    def test_where_others_can_write_is_refused(self, mine, tmp_path):
        folder = tmp_path / "cache" / "phalanx" / "controllers"
        folder.mkdir(parents=True)
        for each in (folder, folder.parent):
            each.chmod(0o777)
            assert f"others can write to {each}" in self.refused(mine())
            each.chmod(0o755)
        digest("mine.py")

    def test_a_parent_that_others_can_write_to_is_refused(self, mine, tmp_path, monkeypatch):
        shared = tmp_path / "shared"
        shared.mkdir()
        monkeypatch.setenv("XDG_CACHE_HOME", str(shared / "cache"))
        shared.chmod(0o777)
        assert f"others can write to {shared}" in self.refused(mine())
        monkeypatch.setattr(building.grp, "getgrgid", lambda _: SimpleNamespace(gr_name="students", gr_mem=[]))
        shared.chmod(0o775)
        assert f"others can write to {shared}" in self.refused("mine.py")
        shared.chmod(0o1777)  # nobody may rename what is in there, as in /tmp
        digest("mine.py")

    def test_a_parent_behind_a_link_is_looked_at(self, mine, tmp_path, monkeypatch):
        (tmp_path / "shared" / "cache").mkdir(parents=True)
        (tmp_path / "shared").chmod(0o777)
        (tmp_path / "link").symlink_to(tmp_path / "shared" / "cache")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "link"))
        assert f"others can write to {tmp_path / 'shared'}" in self.refused(mine())

    def test_a_group_of_the_users_own_is_not_another(self, mine, tmp_path, monkeypatch):
        user = building.pwd.getpwuid(os.geteuid()).pw_name
        monkeypatch.setattr(building.grp, "getgrgid", lambda _: SimpleNamespace(gr_name=user, gr_mem=[]))
        (tmp_path / "cache").mkdir()
        (tmp_path / "cache").chmod(0o775)
        digest(mine())

    def test_parents_are_created_for_the_user_alone(self, mine, tmp_path, monkeypatch):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "cache"))
        before = os.umask(0)
        try:
            digest(mine())
        finally:
            os.umask(before)
        for each in ("home", "home/cache", "home/cache/phalanx", "home/cache/phalanx/controllers"):
            assert (tmp_path / each).stat().st_mode & 0o777 == 0o700

    def test_somebody_elses_is_refused(self, mine, monkeypatch):
        monkeypatch.setattr(building.os, "geteuid", lambda: 12345)
        assert "belongs to user" in self.refused(mine())

    def test_a_link_is_refused(self, mine, tmp_path):
        (tmp_path / "cache" / "phalanx").mkdir(parents=True)
        (tmp_path / "cache" / "phalanx" / "controllers").symlink_to(tmp_path)
        assert "is a link" in self.refused(mine())

    def test_a_refusal_is_one_line(self, phalanx, mine, tmp_path):
        (tmp_path / "cache" / "phalanx").mkdir(mode=0o777, parents=True)
        (tmp_path / "cache" / "phalanx").chmod(0o777)
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", mine())
        assert (code, out) == (2, "")
        assert [each.partition(": ")[0] for each in err.splitlines()] == ["phalanx", "phalanx"]


class TestMistakes:
    def test_what_is_outside_the_subset_is_one_line(self, phalanx, mine):
        words = mine(
            ("    return PLACES * EACH\n\n\n@kernel\ndef size", "    return sum([PLACES, EACH])\n\n\n@kernel\ndef size")
        )
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", words)
        assert (code, out) == (1, "")
        error, hint = err.splitlines()
        assert error == f"phalanx: error: mine.py:{line_of('sum([')}: List is not in the subset: [PLACES, EACH]"
        assert hint == "phalanx: hint: use an array, or a tuple"

    def test_it_is_refused_without_a_compiler_too(self, mine, no_compiler):
        with pytest.raises(OutsideSubset, match=r"mine\.py"):
            digest(mine(("gap = math.sqrt(", "gap = math.exp(")))

    @pytest.mark.parametrize(
        "was, becomes, complaint",
        [
            ("def on_recv", "def on_receive", "mine.py has no function on_recv"),
            ("@kernel\ndef size", "def size", "mine.py has no kernel size"),
            ("def size(_state: Row) -> int", "def size(_state: Row) -> float", "size has another signature"),
            ("def size(_state: Row) -> int", "def size(_state: Row)", "size: the result has no annotation"),
            ("    params=params", "    config=int, params=params", "config of CONTROLLER in mine.py is int"),
            ("@kernel\ndef size(_state: Row) -> int:", "size = kernel(lambda _state: 0)\ndef _s():", "size: "),
        ],
    )
    def test_a_file_of_another_form_is_refused(self, mine, was, becomes, complaint):
        with pytest.raises(UsageError) as refused:
            digest(mine((was, becomes)))
        assert complaint in str(refused.value)
        assert refused.value.hint

    @pytest.mark.parametrize(
        ("was", "becomes", "what"),
        [
            (
                "    is_fine = are_fine(reading",
                "    params[0] = 1.0\n    is_fine = are_fine(reading",
                "on_input writes to params",
            ),
            (
                "    is_fine = are_fine(reading",
                "    put_f32(reading, SAID, 1.0)\n    is_fine = are_fine(reading",
                "on_input writes to reading",
            ),
            (
                "    x, y = get_f32(reading, SAID)",
                "    reading[1:3] = 0\n    x, y = get_f32(reading, SAID)",
                "on_input writes to reading",
            ),
            (
                "        rob = get_u16(packet, ID)",
                "        rest = packet[2:]\n        rest[0] += 1\n        rob = get_u16(packet, ID)",
                "on_recv writes to packet",
            ),
            ("size(_state: Row) -> int:\n", "size(_state: Row) -> int:\n    _state[0] = 1\n", "size writes to _state"),
            (
                "    for at in range(0, length, EACH):\n",
                "    state[0] = 0\n    for at in range(0, length, EACH):\n",
                "is_encoding writes to state",
            ),
        ],
    )
    @pytest.mark.parametrize("compiler", ["cc", "none-such"])
    def test_a_write_to_what_is_only_read_is_refused_with_its_line(
        self, phalanx, mine, monkeypatch, compiler, was, becomes, what
    ):
        monkeypatch.setenv("CC", compiler)
        words = mine((was, becomes))
        (written,) = [line for line in becomes.splitlines() if line not in was and "= packet[" not in line]
        line = line_of("acceleration(params, t" if "reading[" in written else written.strip())
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", words)
        assert (code, out) == (1, "")
        assert err.splitlines() == [
            f"phalanx: error: mine.py:{line}: {what}",
            "phalanx: hint: read it, or write to a copy",
        ]

    def test_a_violation_names_the_file_and_the_line(self, phalanx, mine):
        words = mine(("    ax, ay = 0.0, 0.0\n    if", "    ax, ay = 0.0, 1.0 * (step // (step - step))\n    if"))
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", words)
        assert (code, out) == (1, "")
        error, hint = err.splitlines()
        assert error == f"phalanx: error: mine.py:{line_of('step - step')}: a division by zero"
        assert hint == "phalanx: hint: fix this file: its kernels must not do that"

    @pytest.mark.parametrize("compiler", ["cc", "none-such"])
    def test_one_in_a_kernel_of_ours_names_the_call(self, mine, monkeypatch, compiler):
        monkeypatch.setenv("CC", compiler)
        words = mine(("begin + AX", "begin + 99999"))
        with pytest.raises(OwnDefect, match=rf"^mine.py:{line_of('99999')}: index \d+ is outside an array of \d+$"):
            digest(words)

    def test_one_by_a_peers_frame_rejects_the_frame(self, mine, kernel_defects):
        words = mine(("        rob = get_u16(packet, ID)\n", "        rob = get_u16(packet, 99)\n"))
        assert digest(words)
        (said,) = {each.getMessage().partition("; ")[0] for each in kernel_defects}
        assert all("rejected" in each.getMessage() for each in kernel_defects)
        kernel_defects.clear()
        place = f"mine.py:{line_of('packet, 99')}"
        assert said == (f"{place}: index 99 is outside an array of 27: fix this file: its kernels must not do that")

    @pytest.mark.parametrize(
        "was, becomes, name, complaint",
        [
            ("    return end\n", "    return end + 1\n", "on_input", OUTPUTS),
            ("    return end\n", "    return -1\n", "on_input", OUTPUTS),
            ("    return end\n", "    out[0] = 9\n    return end\n", "on_input", OUTPUTS),
            ("    return end\n", "    out[begin] = 0x81\n    return end\n", "on_input", OUTPUTS),
            ("table.ACCELERATION.size, table.KIND_ACCELERATION", "table.ACCELERATION.size, 7", "on_input", OUTPUTS),
            ("        end = begin + table.STATE.size\n", ACT_AGAIN, "on_input", OUTPUTS),
            (
                "    return PLACES * EACH\n\n\n@kernel\ndef is_enc",
                "    return -1\n\n\n@kernel\ndef is_enc",
                "begin",
                LENGTH,
            ),
            (
                "    return PLACES * EACH\n\n\n@kernel\ndef begin",
                "    return 99999\n\n\n@kernel\ndef begin",
                "size",
                LENGTH,
            ),
            (
                "    return PLACES * EACH\n\n\n@kernel\ndef size",
                "    return 1 << 40\n\n\n@kernel\ndef size",
                "capacity",
                r"\d+ bytes, which no state may have$",
            ),
        ],
    )
    @pytest.mark.parametrize("compiler", ["cc", "none-such"])
    def test_an_invalid_result_names_the_kernel(self, mine, monkeypatch, was, becomes, name, complaint, compiler):
        monkeypatch.setenv("CC", compiler)
        words = mine((was, becomes))
        at = line_of(f"def {name}(") - 1
        with pytest.raises(OwnDefect, match=rf"^mine.py:{at}: returned {complaint}"):
            digest(words)

    def test_a_number_that_no_controller_has_is_refused(self):
        for number in (dispatch.FIRST_OWN + 255, dispatch.FIRST_OWN + 256, 1 << 62):
            with pytest.raises(KernelDefect, match="no controller has the number"):
                dispatch.size(number, np.zeros(3, np.uint8))

    def test_a_file_that_raises_is_one_line(self, phalanx, mine):
        code, _, err = phalanx(
            "sim", "run", "flock-12", *QUICK, "--controller", mine(("PLACES, EACH = 16", "PLACES, EACH = 1 / 0"))
        )
        assert code == 2
        assert err.startswith("phalanx: error: mine.py:")
        assert "ZeroDivisionError" in err
