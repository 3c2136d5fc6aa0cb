"""`phalanx new`: what it writes runs as it is, and nothing is overwritten."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from phalanx.cli.commands.new import ENDINGS, TEMPLATES
from phalanx.lab.determinism import check

KINDS = pytest.mark.parametrize("kind", ENDINGS)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@KINDS
def test_what_is_written_runs_by_the_command_that_is_printed(phalanx, kind, monkeypatch):
    monkeypatch.setattr(check, "OTHERS", 1)
    code, out, err = phalanx("new", kind, "my_first")
    assert (code, err) == (0, f"written: my_first{ENDINGS[kind]}\n")
    program, *words = shlex.split(out)
    assert program == "phalanx"
    code, out, err = phalanx(*words, "--json")
    assert (code, "hint" in err) == (0, False), err
    told = json.loads(out)
    if kind == "controller":
        assert told["correct_in_safe_mode"] == told["without_quorum"] == []
        assert told["contacts"] == 0
        assert phalanx("sim", "check", "my_first.py")[0] == 0
    elif kind == "attack":
        assert (told["attack"], told["stopped_in_time"]) == ("my-first", True)
        assert told["stops"][0]["first_deviation_s"] is not None
        code, out, _ = phalanx("attack", "run", "my_first.py:robot=3,at=10", "--defence", "none", "--json")
        assert (code, json.loads(out)["harm"] > 1.0) == (0, True), "it does something"
    else:
        (liar,) = told["compromised"]
        assert told["correct_in_safe_mode"] == []
        assert liar["safe_mode_s"] is not None


@KINDS
def test_it_has_the_user_s_names(phalanx, folder, kind):
    assert phalanx("new", kind, "my_2nd")[0] == 0
    text = (folder / f"my_2nd{ENDINGS[kind]}").read_text()
    assert "template" not in text.lower()
    assert f"my_2nd{ENDINGS[kind]}" in text
    assert ("class My2nd(" in text) == (ENDINGS[kind] == ".py")


@KINDS
def test_a_file_that_is_there_stays(phalanx, folder, kind):
    path = folder / f"mine{ENDINGS[kind]}"
    path.write_text("kept")
    code, out, err = phalanx("new", kind, "mine")
    assert (code, out, err.splitlines()[0]) == (2, "", f"phalanx: error: {path.name} exists")
    assert path.read_text() == "kept"


@KINDS
@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("My-Flock.py", "my_flock"),
        ("", "my_"),
        ("2nd", "nd"),
        ("../mine", "mine"),
        ("über", "ber"),
        ("a b", "a_b"),
    ],
)
def test_what_is_no_name_is_refused(phalanx, folder, kind, name, hint):
    code, out, err = phalanx("new", kind, name)
    assert (code, out) == (2, "")
    assert f"invalid name {name!r}\nphalanx: hint: use lower-case letters, digits and _: {hint}" in err
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("name", ["random", "numpy", "phalanx"])
def test_a_file_takes_no_module_s_place(phalanx, folder, name):
    for kind in ("controller", "attack"):
        code, _, err = phalanx("new", kind, name)
        assert (code, list(folder.iterdir())) == (2, [])
        assert err == (
            f"phalanx: error: {name} is the name of a Python module\n"
            f"phalanx: hint: use another name, such as my_{name}\n"
        )
    assert phalanx("new", "scenario", name)[0] == 0


def test_a_folder_that_cannot_be_written_to_is_named(phalanx, monkeypatch):
    monkeypatch.chdir("/proc")
    code, _, err = phalanx("new", "scenario", "mine")
    assert (code, err) == (1, "phalanx: error: cannot write mine.yaml: No such file or directory\n")


@pytest.mark.parametrize("words", [(), ("controler", "mine"), ("controller",), ("controller", "mine", "yours")])
def test_words_that_are_missing_or_wrong_are_a_misuse(phalanx, folder, words):
    code, out, err = phalanx("new", *words)
    assert (code, out, list(folder.iterdir())) == (2, "", [])
    assert err.splitlines()[-1].endswith("phalanx new --help")


def test_help_has_an_example(phalanx):
    assert "Example: phalanx new controller my_flock" in phalanx("new", "--help")[1]


def test_every_template_is_a_kind():
    assert {path.name for path in TEMPLATES.glob("*.*") if path.stem != "__init__"} == {
        kind + ending for kind, ending in ENDINGS.items()
    }
