"""The first pages, followed literally in an empty folder: each command of a page, in its order."""

from __future__ import annotations

import json
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from commands import run, start
from ports import free_port

FOLDER = Path(__file__).parent.parent / "docs" / "get-started"
INSTALL = ["git clone URL phalanx", "cd phalanx", "make setup", ". .venv/bin/activate"]  # .ci/run begins with a clone
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SAVED = re.compile(r"Save this as `(\w+\.py)`")


def steps(page: Path) -> list[tuple[str, str]]:
    """Commands and files of a page, in order: ("$", command) or (file name, text)."""
    text = page.read_text()
    found: list[tuple[str, str]] = []
    for block in BLOCK.finditer(text):
        if block[1] == "python":
            found.append((SAVED.findall(text[: block.start()])[-1], block[2]))
        else:
            found += [("$", line.removeprefix("$ ")) for line in block[2].splitlines()]
    return found


def told_well(url: str) -> dict:
    """Return what a gateway says of itself, once it is well."""
    for _ in range(60):
        try:
            return json.load(urllib.request.urlopen(url, timeout=30))
        except urllib.error.HTTPError:
            time.sleep(0.5)
    raise AssertionError("it is not well within 30 s")


def follow(page: Path, folder: Path) -> None:
    """Do what a page says; what is to run until Ctrl-C runs beside the rest.

    Raises: AssertionError: a command failed, or the one that runs beside did not end at Ctrl-C.
    """
    todo, port, running = steps(page), str(free_port()), []
    assert [step for _, step in todo[: len(INSTALL)]] == INSTALL
    try:
        for name, step in todo[len(INSTALL) :]:
            command = step.replace("8081", port)
            if name != "$":
                (folder / name).write_text(step)
            elif command.startswith("phalanx up"):
                files = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
                running.append(start(*shlex.split(command)[1:], cwd=folder, **files))
                assert "://" in running[0].stdout.readline()
            elif command.startswith("curl --fail "):
                assert told_well(command.split()[-1])["shields"] == "working"
            else:
                program, *words = shlex.split(command)
                if program == "phalanx":
                    done = run(*words, cwd=folder, timeout_s=300)
                else:
                    assert program == "python"
                    command = [sys.executable, *words]
                    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
                assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        for each in running:
            each.send_signal(signal.SIGINT)
            assert each.wait(60) == 0
    finally:
        for each in running:
            each.kill()
            each.wait()


@pytest.mark.waits
@pytest.mark.parametrize("page", ["exhibition", "operator"])
def test_a_page_for_people_with_visitors_works_in_an_empty_folder(page, tmp_path):
    follow(FOLDER / f"{page}.md", tmp_path)
    assert (tmp_path / "cards.html").stat().st_size > 1000


def test_the_page_for_researchers_works_in_an_empty_folder(tmp_path):
    follow(FOLDER / "researcher.md", tmp_path)
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_page_for_security_engineers_works_in_an_empty_folder(tmp_path):
    follow(FOLDER / "security.md", tmp_path)


def test_every_first_page_says_for_whom_it_is():
    for page in FOLDER.glob("*.md"):
        assert re.match(r"# .*\n\nFor (people|everybody) who ", page.read_text()), page.name
