"""What commands say on stderr while they work, and when they are stopped; what they refuse in one line everywhere."""

from __future__ import annotations

import logging
import math
import os
import re
import sys
from pathlib import Path

import click
import pytest

from commands import ROOT
from phalanx.cli import link, reproduce, sim, terminal
from phalanx.cli.main import ABOUT, main, phalanx, run_command
from phalanx.errors import Unavailable

ROBOT_SAID = """
robot: 1
mission: flock-12
key: mission.json
trusted: process:flash
driver: arena:here
radio: {here: 127.0.0.1:4411, peers: [127.0.0.1:4412]}
"""


def commands(command: click.Command = phalanx):
    """Every command that is no group."""
    if not isinstance(command, click.Group):
        return [command]
    return [each for name in command.commands for each in commands(command.commands[name])]


class TestStopped:
    @pytest.mark.parametrize("figure", ["bti-fig9", "mission-fig8a"])
    def test_a_command_claims_no_file_that_is_not_there(self, figure, monkeypatch, capsys, tmp_path):
        def measure(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(reproduce, "measure", measure)
        command = ["reproduce", figure, "--out", str(tmp_path)]
        assert run_command(command) == 1
        assert capsys.readouterr().err.splitlines() == ["stopped"]
        csv = tmp_path / f"{figure}.csv"
        csv.touch()
        assert run_command(command) == 1
        assert f"in {csv}, run the same command again to continue" in capsys.readouterr().err

    def test_a_run_that_was_stopped_before_it_recorded_claims_no_recording(self, monkeypatch, capsys, tmp_path):
        def stop(_scenario, record, *_, **_more):
            if writes:
                record.write_bytes(b"now")
            raise KeyboardInterrupt

        monkeypatch.setattr(sim, "run_scenario", stop)
        path = tmp_path / "run.mcap"
        for writes, there in ((False, False), (False, True), (True, True)):
            if there:
                path.write_bytes(b"an earlier one")
                os.utime(path, (0, 0))
            assert run_command(["sim", "run", "flock-12", "--record", str(path)]) == 1
            last = capsys.readouterr().err.splitlines()[-1]
            assert last == (f"stopped; recorded so far: {path}" if writes else "stopped")


class TestProgress:
    def test_where_there_is_no_terminal_it_is_a_line_each_few_seconds_and_the_last(self, monkeypatch, capsys):
        now_s = 0.0
        monkeypatch.setattr(terminal.time, "monotonic", lambda: now_s)
        progress = terminal.Progress()
        for k in range(1, 101):
            now_s = k * 0.12
            progress.tell(f"{k} of 100", k / 100)
        progress.tell("100 of 100", 1.0)
        assert capsys.readouterr().err.splitlines() == ["42 of 100", "84 of 100", "100 of 100"]


class TestEveryCommand:
    def test_no_number_may_be_nan_or_infinite(self, capsys):
        taken = 0
        for command in commands():
            for option in command.params:
                if isinstance(option.type, click.types.FloatParamType):
                    taken += 1
                    for value in (math.nan, math.inf):
                        with pytest.raises(click.UsageError):
                            option.process_value(click.Context(command), value)
        assert taken > 20
        assert run_command(["up", "--duration", "nan"]) == 2
        assert capsys.readouterr().err.startswith("phalanx: error: Invalid value for '--duration': nan is not a finite")

    @pytest.mark.parametrize(
        "path", [[], *([name] for name in ABOUT if name not in ("docs", "doctor", "new", "sweep", "up"))]
    )
    def test_a_group_s_help_says_what_each_command_does_to_the_end(self, path, capsys):
        assert run_command([*path, "--help"]) == 0
        listed = capsys.readouterr().out.partition("Commands:")[2].partition("\n\n")[0]
        assert "..." not in listed
        group = phalanx.commands[path[0]] if path else phalanx
        assert all(re.search(rf"^  {name}  ", listed, re.MULTILINE) for name in group.commands)


class TestMissionFiles:
    @pytest.mark.parametrize(
        "words", [["build", "office", "--profile", "paper"], ["draw", "office"]], ids=["build", "draw"]
    )
    def test_a_file_that_cannot_be_written_is_a_failure_not_a_misuse(self, words, capsys):
        if words[0] == "draw":
            pytest.importorskip("matplotlib")
        assert run_command(["mission", *words, "--out", "/proc/nowhere.svg"]) == 1
        assert "error: cannot write /proc/nowhere.svg" in capsys.readouterr().err

    def test_what_is_no_mission_is_named(self, tmp_path, capsys):
        path = tmp_path / "notes.txt"
        path.write_text("no mission")
        for command in ("inspect", "verify", "crack"):
            assert run_command(["mission", command, str(path)]) == 1
            assert f"{path} is not an encoded mission: 55 bytes wanted" in capsys.readouterr().err

    def test_a_header_without_limits_says_so_in_words(self, tmp_path, capsys):
        path = tmp_path / "office.phxm"
        assert run_command(["mission", "build", "office", "--profile", "paper", "--out", str(path)]) == 0
        capsys.readouterr()
        assert run_command(["mission", "inspect", str(path)]) == 0
        said = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()[:9])
        assert [said[name] for name in ("robots", "valid_to_s", "signer")] == ["any", "unlimited", "none"]


class TestWhere:
    def test_two_pages_on_one_port_are_refused_at_once(self, capsys):
        assert run_command(["up", "--port", "8080", "--operator-port", "8080"]) == 2
        assert "port 8080 for both pages" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            (
                ["up", "--qrkey", "--broker", "mosquitto", "--broker-login", "nowhere"],
                "--broker-login with --broker mosquitto",
            ),
            (["doctor", "--broker-login", "{login}"], "without --broker"),
            (["doctor", "--broker", "localhost", "--broker-ws", "localhost:9001"], "browsers cannot use mqtt://"),
        ],
    )
    def test_what_is_for_another_broker_or_none_is_refused_at_once(self, words, said, tmp_path, capsys):
        (tmp_path / "login").write_text("me:secret\n")
        assert run_command([word.format(login=tmp_path / "login") for word in words]) == 2
        assert said in capsys.readouterr().err

    @pytest.mark.parametrize("is_terminal", [True, False])
    def test_what_is_logged_stands_in_the_place_of_a_status_line(self, is_terminal, monkeypatch, capsys):
        monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal, raising=False)
        assert run_command(["sim", "schema"]) == 0
        logging.getLogger("phalanx.test").warning("the broker is lost")
        before = r"\r\x1b\[2Kphalanx: warning:" if is_terminal else r"phalanx: warning: [-+0-9T:]{24}"
        assert re.fullmatch(before + " the broker is lost\n", capsys.readouterr().err)


class TestRobots:
    def test_robots_of_the_gateway_are_columns_and_others_what_they_say(self, capsys):
        robots = [
            {"address": "A1", "name": "Ada", "lh2_position": {"x": 1, "y": 2}, "battery": 2.5, "status": 0},
            {"address": "A2", "name": "Bo", "lh2_position": {"x": 1, "y": 2}, "battery": 0, "status": 0},
            {"address": "ROBOT-1", "wheels": [60, -60]},
        ]
        link._show_robots(robots, as_json=False)
        ours, silent, theirs = capsys.readouterr().out.splitlines()
        assert silent.split() == ["A2", "Bo", "1", "2", "mm", "active"], "a battery that tells nothing is not empty"
        assert ours.split() == ["A1", "Ada", "1", "2", "mm", "2.50", "V", "active"]
        assert theirs.split(maxsplit=1) == ["ROBOT-1", "wheels=[60, -60]"]

    def test_lists_fit_the_terminal_and_are_a_line_each_where_there_is_none(self, monkeypatch, capsys):
        head, text = "office   ", "a dozen robots " * 10
        assert terminal.beside(head, text) == head + text
        monkeypatch.setattr(terminal.sys.stdout, "isatty", lambda: True, raising=False)
        monkeypatch.setenv("COLUMNS", "60")
        lines = terminal.beside(head, text).splitlines()
        assert len(lines) > 2
        assert all(len(line) <= 60 and line.startswith((head, " " * len(head))) for line in lines)

    async def test_what_a_list_has_beside_robots_is_told_and_an_address_alone_is_one(self, capsys):
        class Visitor:
            async def robots(self):
                return ["A1", {"address": "B2"}, 7, {"name": "nobody"}, "a/#"]

        assert await link._Robots(Visitor()).listed() == [{"address": "A1"}, {"address": "B2"}]
        assert "not robots, but in the list: 7, {'name': 'nobody'}, {'address': 'a/#'}\n" in capsys.readouterr().err
        link._show_robots([], as_json=False)
        assert capsys.readouterr().err == "phalanx: the swarm lists no robots\n"

    async def test_a_robot_that_is_not_listed_is_driven_if_one_insists_and_each_by_its_own_application(self, capsys):
        said = []

        class Visitor:
            async def robots(self):
                return [{"address": "A1", "application": 1}]

            async def drive(self, *words):
                said.append(words)
                return 1

        with pytest.raises(Unavailable, match="no robot A2"):
            await link._drive(link._Robots(Visitor()), "A2", (1, 1), 0.1, as_json=False)
        assert not said
        await link._drive(link._Robots(Visitor(), unlisted=True), "A2", (1, 1), 0.1, as_json=False)
        assert capsys.readouterr().out == "1 command to A2; it is not known whether such a robot exists\n"
        await link._drive(link._Robots(Visitor()), "A1", (1, 1), 0.1, as_json=False)
        assert said == [("A2", "0", (1, 1), 0.1), ("A1", "1", (1, 1), 0.1)]

    async def test_a_drive_shows_the_robot_before_and_after(self, capsys):
        class Visitor:
            x_mm = 0

            async def robots(self):
                return [{"address": "A1", "name": "Ada", "lh2_position": {"x": self.x_mm, "y": 0}}]

            async def drive(self, *_words):
                self.x_mm += 2
                return 1

        await link._drive(link._Robots(Visitor()), "ada", (1, 1), 0.1, as_json=False)
        before, after = (line.split() for line in capsys.readouterr().out.splitlines())
        assert before[:4] == ["before", "A1", "Ada", "0"]
        assert after[:4] == ["after", "A1", "Ada", "2"]


def test_what_setup_installs_can_draw():
    assert re.search(r"^matplotlib==", (ROOT / "requirements.lock").read_text(), re.MULTILINE)


@pytest.mark.parametrize(
    ("words", "says", "hint"),
    [
        ("mission run drawn:7", "no file drawn:7", "mission build --map drawn:7 --out FILE"),
        ("mission run drwn:7", "no file drwn:7", "mission build --map drawn:7 --out FILE"),
        ("mission audit office_40x40", "no file office_40x40", "mission build --map office_40x40 "),
        ("mission run ofice", "no file ofice", "did you mean office?"),
        ("mission inspect office", "no file office", "first run phalanx mission build office --out FILE"),
        ("up --world drwn:7", "no map 'drwn:7'", "did you mean drawn:7?"),
        ("up --defence hardned", "'hardned' is not one of", "did you mean hardened? phalanx up --help"),
        ("up --defence bound", "'bound' is not one of", "did you mean hardened? phalanx up --help"),
        ("up --world drawn:ofice", "no building is called 'drawn:ofice'", "did you mean office?"),
        ("mission run office --noise 0.03,0.05,stge", "noise '0.03,0.05,stge'", "did you mean stage?"),
        ("sim run flock-12 --attack spoof:robt=3", "has no option 'robt'", "did you mean robot?"),
        ("robot arena --on-air repaly:robot=1", "no such attack or option", "did you mean replay?"),
        ("robot arena --on-air replay:robt=1", "no such attack or option", "did you mean robot?"),
        ("mission run office --record /nowhere/x.mcap", "no folder /nowhere", "create it first"),
        ("mission run office --start 100,100", "no robot can stand at (100, 100) in ", "x 0 to 40, y 0 to 40 m"),
        ("mission run office --start 0,0", "no robot can stand at (0, 0) in ", "away from walls"),
    ],
)
def test_whoever_errs_is_told_at_once_what_they_may_have_meant(capsys, words, says, hint):
    assert run_command(words.split()) == 2
    error, hinted = capsys.readouterr().err.splitlines()[-2:]
    assert says in error
    assert hint in hinted


@pytest.mark.parametrize(
    ("command", "said", "hint"),
    [
        ("sim run {}", "controller: flok", "did you mean flock?"),
        ("sim run {}", "defence: hardned", "did you mean hardened?"),
        ("sim run {}", "defence: bound", "did you mean hardened? one of none, paper, hardened"),
        ("sweep {}", "scenario: flock-12\ngrid: {defense: [none]}", "did you mean defence?"),
        ("mission build {} --out x.phxm", "mision: x", "did you mean mission?"),
        ("mission build {} --out x.phxm", "mission: x\nnodes: {A: {see: {dorway: [1, 2]}}}", "did you mean doorway?"),
        ("robot run {}", ROBOT_SAID.replace("process", "proces"), "did you mean process?"),
        ("robot run {}", ROBOT_SAID.replace("arena", "aerna"), "did you mean arena?"),
    ],
)
def test_a_word_in_a_file_that_is_nearly_one_is_told_as_that(command, said, hint, tmp_path, capsys):
    (tmp_path / "said.yaml").write_text(said)
    assert run_command(command.format(tmp_path / "said.yaml").split()) == 2
    error, hinted = capsys.readouterr().err.splitlines()
    assert re.search(r"said\.yaml:\d", error)
    assert hint in hinted


@pytest.mark.parametrize(
    ("words", "there"),
    [
        ("mission inspect {}", "tour.phxm"),
        ("sim run {}", "tour.yaml"),
        ("sim run flock-12 --controller {}:Mine", "tour.py"),
        ("sweep {}", "tour.yml"),
        ("robot run {}", "tour.yaml"),
        ("doctor --broker mqtt://127.0.0.1:1 --broker-login {}", "tour.login"),
        ("keys list {}", "tour.keys"),  # before anybody is asked for a passphrase
        ("keys issue {} --out /nowhere", "tour.keys"),
    ],
)
def test_a_file_of_nearly_that_name_is_offered(words, there, tmp_path, capsys):
    (tmp_path / there).touch()
    (tmp_path / "other").with_suffix(Path(there).suffix).touch()
    meant = tmp_path / f"tuor{Path(there).suffix}"
    assert run_command(words.format(meant).split()) == 2
    error, hint = capsys.readouterr().err.splitlines()
    assert str(meant) in error
    assert f"did you mean {there}? " in hint
    assert not list(tmp_path.glob("*.lock")), "nothing is left beside what is not there"


def test_what_ctrl_c_left_half_made_goes_without_a_traceback(monkeypatch, capsys):
    class HalfMade:
        def __del__(self):
            raise AttributeError("expr")

    monkeypatch.setattr(sys, "argv", ["phalanx", "--version"])
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)  # as it was afterwards
    monkeypatch.setattr("gc.set_threshold", lambda _: None)
    with pytest.raises(SystemExit):
        main()
    HalfMade()
    assert "expr" not in capsys.readouterr().err
