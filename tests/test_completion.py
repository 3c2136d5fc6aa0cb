"""The Tab key: click's protocol between a shell and a child process, and a real bash."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys

import pytest

from phalanx.attacks import IN_SWARMS
from phalanx.cli.main import run_command
from phalanx.config.builtin import built_in
from phalanx.robot.adversary.registry import attacks
from phalanx.scenarios.scenario import PROTOCOLS

SCENARIOS, MISSIONS, MAPS = (list(built_in(kind)) for kind in ("scenarios", "missions", "maps"))


@pytest.fixture
def shell(tmp_path):
    """A folder with a user's files, and an environment in which `phalanx` is a command."""
    command = tmp_path / "bin" / "phalanx"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m phalanx "$@"\n')
    command.chmod(0o755)
    here = tmp_path / "here"
    (here / "more").mkdir(parents=True)
    for name in ("mine.py", "mine.yaml", "more/other.yaml", "made.phxm", "notes.txt"):
        (here / name).touch()
    return here, {**os.environ, "PATH": f"{command.parent}:{os.environ['PATH']}"}


def told(shell, *words: str, **said: str) -> list[str]:
    here, environment = shell
    done = subprocess.run(
        [*words], cwd=here, env=environment | said, capture_output=True, text=True, check=True, timeout=60
    )
    assert not done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def offered(shell, monkeypatch, capsys):
    """What is offered for the last word of a command line, asked in this process."""
    monkeypatch.chdir(shell[0])
    monkeypatch.setenv("_PHALANX_COMPLETE", "bash_complete")

    def ask(line: str) -> list[str]:
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        with pytest.raises(SystemExit, match="0"):
            run_command([])
        out, err = capsys.readouterr()
        assert not err
        return [words.partition(",")[2] for words in out.splitlines() if words.startswith("plain,")]

    return ask


@pytest.mark.parametrize(
    "line, names, files",
    [
        ("phalanx sim run ", SCENARIOS, ["mine.yaml"]),
        ("phalanx sim run flock-12 --attack ", ["none", *IN_SWARMS], ["mine.py"]),
        ("phalanx attack run ", attacks(), ["mine.py"]),
        ("phalanx sim run flock-12 --controller ", ["flock", "guard", *PROTOCOLS], ["mine.py"]),
        ("phalanx attack run spoof --controller ", ["flock", "guard", *PROTOCOLS], ["mine.py"]),
        ("phalanx sim check ", ["flock", "guard", "wheels", *PROTOCOLS], ["mine.py"]),
        ("phalanx mission build ", MISSIONS, ["mine.yaml"]),
        ("phalanx mission build --map ", MAPS, ["mine.yaml"]),
        ("phalanx mission run ", MISSIONS, ["made.phxm", "mine.yaml"]),
        ("phalanx mission run office --world ", MAPS, ["mine.yaml"]),
        ("phalanx mission inspect ", [], ["made.phxm"]),
        ("phalanx up --mission ", MISSIONS, ["made.phxm", "mine.yaml"]),
        ("phalanx up --furnish ", MISSIONS, ["mine.yaml"]),
        ("phalanx up --defence ", ["hardened", "none", "paper"], []),
    ],
)
def test_names_and_files_are_offered(offered, line, names, files):
    assert sorted(offered(line)) == sorted([*names, *files])


def test_what_is_begun_is_ended(offered):
    assert offered("phalanx sim run bti") == ["bti-fig2", "bti-fig8", "bti-fig9"]
    assert offered("phalanx sim run more/") == ["more/other.yaml"]
    assert offered("phalanx sim run ./m") == ["./mine.yaml"]
    assert offered("phalanx attack run spo") == ["spoof", "spoof-scan"]


def test_behind_a_file_its_classes_are_offered_and_it_is_not_run(shell, offered):
    here, _ = shell
    (here / "mine.py").write_text("class Mine: pass\nclass Min(Mine): pass\nclass _Not: pass\nraise SystemExit(3)")
    (here / "bad.py").write_text("class")
    both = ["mine.py:Min", "mine.py:Mine"]
    for words in ("sim check", "sim run flock-12 --controller", "sim run flock-12 --attack", "attack run"):
        assert sorted(offered(f"phalanx {words} mine.py")) == both, "bash ends a word before a colon"
        assert sorted(offered(f"phalanx {words} mine.py:M")) == both
    assert offered("phalanx sim check mine.py:Mine") == ["mine.py:Mine"]
    assert offered("phalanx sim check bad.py") == ["bad.py"]


def test_commands_are_offered_and_the_shell_offers_other_files(shell, offered):
    assert offered("phalanx si") == ["sim"]
    assert offered("phalanx sim ") == ["check", "list", "run", "schema", "view"]
    assert {"bti-fig8", "link-fig4", "mission-fig10"} <= set(offered("phalanx reproduce "))
    said = {"COMP_WORDS": "phalanx sim run no", "COMP_CWORD": "3", "_PHALANX_COMPLETE": "bash_complete"}
    assert told(shell, "phalanx", **said) == ["file,no"]


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash")
def test_bash_completes(shell):
    script = (
        'eval "$(_PHALANX_COMPLETE=bash_source phalanx)"; complete -p phalanx;'
        'COMP_WORDS=(phalanx sim run bti-fig); COMP_CWORD=3; _phalanx_completion phalanx; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    bound, *offers = told(shell, "bash", "-c", script)
    assert bound == "complete -o nosort -F _phalanx_completion phalanx"
    assert offers == ["bti-fig2", "bti-fig8", "bti-fig9"]


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_each_shell_has_a_script(shell, name):
    assert any("_PHALANX_COMPLETE" in line for line in told(shell, "phalanx", _PHALANX_COMPLETE=f"{name}_source"))
