"""What stands in deploy/: linted, and held to what the rest of the repository says."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

from commands import ROOT
from phalanx.daemon.driver import make_driver
from phalanx.daemon.settings import read_robot
from phalanx.gateway.up import DEFAULT_PORT
from phalanx.robot.controllers import dispatch
from phalanx.scenarios.file import read_scenario
from phalanx.scenarios.scenario import for_robots
from phalanx.wire import table

DEPLOY = ROOT / "deploy"
KNOWN = {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENV", "VOLUME", "EXPOSE", "ENTRYPOINT"}


def faults_of_unit(text: str, folder: Path) -> list[str]:
    """What systemd says of a unit whose program is there."""
    program = folder / "phalanx"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unit = folder / "phalanx.service"
    unit.write_text(text.replace("/opt/phalanx/bin/phalanx", str(program)))
    words = ["systemd-analyze", "verify", "--man=no", str(unit)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    return [line for line in done.stderr.splitlines() if "phalanx.service" in line]


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd here")
def test_systemd_takes_every_line_of_the_units(tmp_path):
    assert faults_of_unit((DEPLOY / "robot" / "phalanx-robot@.service").read_text(), tmp_path) == []
    text = (DEPLOY / "phalanx.service").read_text()
    assert faults_of_unit(text, tmp_path) == []
    for right, wrong in (("ProtectHome=yes", "ProtectHomes=yes"), ("RestartSec=2", "RestartSec=soon")):
        assert right in text
        assert faults_of_unit(text.replace(right, wrong), tmp_path)


def test_what_a_unit_prints_goes_where_something_is_when_it_is_opened():
    """systemd makes a unit's own folders later, and no command says so before it is started."""
    unit = (DEPLOY / "phalanx.service").read_text()
    (where,) = re.findall(r"^StandardOutput=truncate:(.*)$", unit, re.MULTILINE)
    assert Path(where).parent == Path("/run")
    assert not re.search(r"^[^#]*--events", unit, re.MULTILINE), "a line for each command would fill memory"
    assert f"cat {where} " in (ROOT / "docs" / "guides" / "service.md").read_text()


def steps() -> list[tuple[str, str]]:
    """Instruction and words of each step of the Containerfile."""
    text = re.sub(r"^#.*\n", "", (DEPLOY / "Containerfile").read_text(), flags=re.MULTILINE).replace("\\\n", " ")
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in text.splitlines() if line.strip()]


def told(instruction: str) -> list[str]:
    return [words for name, words in steps() if name == instruction]


class TestContainerfile:
    def test_each_step_is_one_that_there_is_and_each_stage_is_made_before_it_is_used(self):
        made = []
        for name, words in steps():
            assert name in KNOWN
            if name == "FROM":
                image, *stage = words.split(" AS ")
                assert re.fullmatch(r"docker\.io/library/\w+:[\w.-]*\d[\w.-]*", image), "of a version"
                made += stage
            for used in re.findall(r"(?:--from=|,from=)(\w+)", words):
                assert used in made
        assert len(made) == 2

    def test_of_a_checkout_it_has_what_it_is_built_from_and_no_key_of_ones_own(self):
        first, *others = re.sub(r"^#.*\n", "", (ROOT / ".dockerignore").read_text(), flags=re.MULTILINE).split()
        assert first == "*", "nothing, but for what follows"
        taken = {line[1:] for line in others if line.startswith("!")}
        kept = set(subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines())
        assert taken <= kept | {path.split("/")[0] for path in kept}
        needed = {"LICENSE", "README.md", "firmware", "pyproject.toml", "release", "setup.py", "src", "web"}
        needed |= {"phalanx_compiler", "deploy", "docs", "examples"}  # its setup.py imports or copies them
        assert needed | set(re.findall(r"\S+\.lock", " ".join(told("RUN")))) <= taken
        assert {"**/.*", "**/*.key", "**/node_modules", "**/*.so", "src/phalanx/gateway/pages"} <= set(others)

    def test_a_new_wheel_makes_a_new_layer(self):
        before, last = steps()[: [name for name, _ in steps()].index("USER")][-2:]
        assert (before[0], before[1].split()[0]) == ("COPY", "--from=wheels")
        assert (last[0], last[1].split()[0]) == ("RUN", "--mount=type=bind,from=wheels,source=/wheels,target=/wheels")

    def test_its_images_have_what_the_project_asks_for(self):
        node = int(re.search(r"node:(\d+)-", told("FROM")[0])[1])
        assert node >= int(
            re.search(r"\d+", json.loads((ROOT / "web" / "package.json").read_text())["engines"]["node"])[0]
        )
        python = re.search(r"python:([\d.]+)-", told("FROM")[2])[1]
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        assert f"Programming Language :: Python :: {python}" in project["classifiers"]
        assert [re.search(r"python:([\d.]+)-", image)[1] for image in told("FROM")[1:]] == [python, python], "of wheels"

    def test_what_it_runs_is_what_there_is_to_run(self):
        runs = " && ".join(told("RUN"))
        scripts = json.loads((ROOT / "web" / "package.json").read_text())["scripts"]
        assert set(re.findall(r"npm run --prefix web (\S+)", runs)) <= set(scripts)
        assert "npm ci --prefix web" in runs
        assert (ROOT / "web" / "package-lock.json").exists()
        assert [name for name in re.findall(r"\S+\.lock", runs) if not (ROOT / name).exists()] == []
        assert "touch src/phalanx/gateway/pages/built" in runs
        makefile = (ROOT / "Makefile").read_text()
        assert "\nPAGES := src/phalanx/gateway/pages\n" in makefile
        assert "\n$(PAGES)/built:" in makefile, "what make looks for"
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        assert re.search(r"--find-links /wheels (\S+)$", told("RUN")[-1])[1] == project["name"]
        for line in told("RUN"):
            if "apt-get install" in line:
                assert "apt-get update" in line
                assert "--no-install-recommends" in line
                assert "rm -rf /var/lib/apt/lists/*" in line

    def test_whoever_runs_it_is_nobody_who_may_do_much_and_the_ports_are_those_of_a_gateway(self):
        (user,) = told("USER")
        assert f"useradd --uid {user} " in " ".join(told("RUN"))
        assert [name for name, _ in steps()].index("USER") < [name for name, _ in steps()].index("ENTRYPOINT")
        assert told("EXPOSE") == [f"{DEFAULT_PORT}"]


def test_the_files_of_three_robots_are_ones_that_phalanx_reads(tmp_path):
    folder = DEPLOY / "robot"
    scenario = for_robots(read_scenario(folder / "mission.yaml"))
    first = read_robot(folder / "robot-1.yaml").said
    gateway = yaml.safe_load((folder / "robots.yaml").read_text())
    where = {each["robot"]: each["at"] for each in gateway["robots"]}
    assert list(where) == list(range(1, scenario.robots + 1))
    assert first.radio.here == where.pop(1)
    assert set(first.radio.peers) == {*where.values(), gateway["here"]}
    assert (first.mission, first.key) == (gateway["mission"], gateway["key"])
    for name in ("robot-1.yaml", "base.py", "motors.py"):
        shutil.copy(folder / name, tmp_path / name)
    driver = make_driver(read_robot(tmp_path / "robot-1.yaml"), dispatch.BUNDLED[scenario.controller])
    with contextlib.closing(driver):
        before = table.WHEELS_SENSOR.decode(asyncio.run(driver.sense(1, 30.0)))
        driver.drive(table.WHEELS_COMMAND.encode(id=1, t=1, left=100, right=100, red=0, green=0, blue=0))
        assert table.WHEELS_SENSOR.decode(asyncio.run(driver.sense(2, 30.0)))["y_mm"] > before["y_mm"]
    assert (tmp_path / "motors-1.txt").read_text().split() == ["0", "0"]


def test_the_watchdog_of_the_sample_motors_is_longer_than_what_a_mission_takes_between_two_commands():
    bti = for_robots(read_scenario(DEPLOY / "robot" / "mission.yaml")).bti
    (watchdog_s,) = re.findall(r"^WATCHDOG_S = (.*)$", (DEPLOY / "robot" / "motors.py").read_text(), re.MULTILINE)
    assert float(watchdog_s) > (bti.t_control_ms + 2 * bti.delta_ms) / 1000
