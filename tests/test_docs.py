"""The documentation agrees with the code: commands exist, tables and figures are the code's, links lead somewhere."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import json
import math
import re
import runpy
import shlex
import signal
import sys
import tomllib
import types
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from click.testing import CliRunner

from brokers import bare_mosquitto
from phalanx import __version__, crypto, errors
from phalanx.cli.main import phalanx
from phalanx.config import LinkConfig
from phalanx.crypto import jwe
from phalanx.gateway import vocabulary
from phalanx.gateway.missions.desk import requests_of
from phalanx.gateway.operator_desk import OperatorDesk
from phalanx.link import Pin, QrkeyClient, QrUrl, derive_epoch, pin, topics
from phalanx.link.rotation import State
from phalanx.mission.landmarks import floorplan, floorplan_of_yaml
from phalanx.mission.landmarks.gridmap import parse_map_header
from phalanx.net.session_client import Client
from ports import free_port
from scripts import loaded

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "examples").glob("*.md")])
LINK = (DOCS / "spec" / "link.md").read_text()
CODE = re.compile(r"`([^`]+)`")


def each_page(pages=PAGES):
    return pytest.mark.parametrize("page", pages, ids=lambda page: str(page.relative_to(ROOT)))


def fences(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def prose(text: str) -> str:
    """The text without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def table(text: str, first: str) -> list[list[str]]:
    """The rows of the tables whose header begins with `first`; cells without their backticks."""
    rows: list[list[str]] = []
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        inside = bool(cells) and (inside or cells[0] == first)
        if inside and cells[0] != first and not set("".join(cells)) <= set("-:"):
            rows.append([cell.strip("`") if cell.count("`") == 2 else cell for cell in cells])
    assert rows, f"no table of {first}"
    return rows


# --- commands ---------------------------------------------------------------------------------------------------------


def parse_phalanx(words: list[str]) -> list[str]:
    """The command's path; fails as the command line would if a command, option or value is unknown."""
    command: click.Command = phalanx
    path: list[str] = []
    while isinstance(command, click.Group):
        assert words, f"phalanx {' '.join(path)}: which command?"
        path.append(words[0])
        assert words[0] in command.commands, f"no command phalanx {' '.join(path)}"
        command, words = command.commands[words[0]], words[1:]
    with contextlib.suppress(click.exceptions.Exit):
        command.make_context(path[-1], list(words))
    return path


def make_targets() -> set[str]:
    return set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def commands_of(page: Path) -> list[str]:
    lines = "\n".join(fences(page.read_text(), "console")).splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


@each_page([page for page in PAGES if commands_of(page)])
def test_every_command_line_would_be_understood(page):
    for line in commands_of(page):
        program, *words = shlex.split(line)
        if program == "phalanx":
            path = parse_phalanx(words)
            assert CliRunner().invoke(phalanx, [*path, "--help"]).exit_code == 0, line
        elif program == ".venv/bin/phalanx":
            parse_phalanx(words)
        elif program == "make":
            assert set(words) <= make_targets(), line
        else:
            assert program in (".", "cd", "git", "/usr/sbin/mosquitto", "curl", "python"), f"who checks {line!r}?"


def test_the_launch_example_starts_commands_that_there_are(monkeypatch):
    """With a stand-in for `launch`, of which there is no wheel; docs/guides/ros2.md says when the true one ran it."""

    def keeps(*said, **more):
        return (said, more)

    for name in ("launch", "launch.actions", "launch.substitutions"):
        module = types.ModuleType(name)
        for what in ("LaunchDescription", "DeclareLaunchArgument", "ExecuteProcess", "LaunchConfiguration"):
            setattr(module, what, keeps)
        monkeypatch.setitem(sys.modules, name, module)
    ((entities,), _) = runpy.run_path(str(ROOT / "examples" / "ros2.launch.py"))["generate_launch_description"]()
    commands = [more["cmd"] for _, more in entities if "cmd" in more]
    assert len(commands) == 4
    for program, *words in commands:
        assert program == "phalanx"
        parse_phalanx([word if isinstance(word, str) else "README.md" for word in words])


def test_nobody_is_sent_to_an_index_that_has_no_phalanx():
    """In the container, `--no-index` installs the wheel that was just built."""
    told = [*PAGES, *(ROOT / "src").rglob("*.py"), *(ROOT / "examples").rglob("*.*"), *(ROOT / "deploy").iterdir()]
    wrong = re.compile(r"phalanx-swarm\[|pip install (?!.*--no-index).*phalanx[-_]swarm(?!-\*\.whl)")
    found = [
        f"{path}: {each[0]}"
        for path in told
        if path.is_file() and path.suffix != ".pyc"
        for each in wrong.finditer(path.read_text())
    ]
    assert not found


@each_page()
def test_commands_named_in_the_text_exist(page):
    for words in CODE.findall(prose(page.read_text())):
        if words.startswith("make "):
            assert set(words.split()[1:]) <= make_targets(), words
        if words.startswith("phalanx ") and "`" not in words:
            command: click.Command = phalanx
            for word in words.split()[1:]:
                if not isinstance(command, click.Group):
                    break
                assert word in command.commands, words
                command = command.commands[word]


def test_the_building_that_is_shown_is_built_from_and_run_in(tmp_path, monkeypatch):
    page = DOCS / "guides" / "maps.md"
    flat, depot = fences(page.read_text(), "yaml")
    assert floorplan_of_yaml(flat.encode()).codes
    assert parse_map_header(depot.encode(), "depot").start == (3.0, 7.5, 0.0)
    (tmp_path / "flat.yaml").write_text(flat)
    monkeypatch.chdir(tmp_path)
    for line in commands_of(page)[:2]:
        told = CliRunner().invoke(phalanx, shlex.split(line)[1:])
        assert told.exit_code == 0, told.output
    assert "1 of 1 robot completed" in told.stdout
    shown = {row[0] for row in table(page.read_text(), "key")}
    readers = floorplan.floorplan_of_yaml, floorplan.start_pose, floorplan.extraction_of, floorplan.sources_of
    reader = "".join(map(inspect.getsource, readers))
    assert shown == set(re.findall(r'(?:content(?:\.get\(|\[)|\((?="[a-z]+", [A-Z]))"([a-z_]+)"', reader))


def test_the_list_of_commands_names_every_command():
    def commands(command: click.Command, path: str) -> set[str]:
        if not isinstance(command, click.Group):
            return {path}
        return set().union(*(commands(inner, f"{path} {name}") for name, inner in command.commands.items()))

    named = {
        words
        for words in CODE.findall(prose((DOCS / "reference" / "commands.md").read_text()))
        if words.startswith("phalanx ")
    }
    assert named == commands(phalanx, "phalanx")


def test_options_named_in_the_text_exist():
    def options(command: click.Command) -> set[str]:
        children = command.commands.values() if isinstance(command, click.Group) else ()
        return {word for p in command.params for word in p.opts}.union(*map(options, children))

    known = options(phalanx) | {"--help"}
    for page in PAGES:
        for code in CODE.findall(prose(page.read_text())):
            named = re.match(r"(--[a-z-]+)", code)
            assert named is None or named[1] in known, f"{page.name}: {code}"


def test_the_first_screen_begins_with_a_clone_and_names_the_shields():
    first = "\n".join((ROOT / "README.md").read_text().splitlines()[:40])
    assert commands_of(ROOT / "README.md") == ["git clone URL phalanx", "cd phalanx", "make demo"]
    assert all(f"**{shield}**" in first for shield in ("link", "encoded mission", "Bounded-time interaction"))


def test_every_paper_is_cited_where_it_is_named():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    rows = (ROOT / "README.md").read_text().splitlines()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert len(citation["references"]) == 3
    assert citation["version"] == __version__
    for paper in citation["references"]:
        (row,) = [row for row in rows if f"*{paper['title']}*" in row]
        assert all(author["family-names"] in row for author in paper["authors"])
        assert re.search(rf"(20|'){paper['year'] % 100}\b", row)
        where = f"https://doi.org/{paper['doi']}" if "doi" in paper else paper["url"]
        assert f"({where})" in row
        assert f"({paper.get('repository-code', where)})" in row
        assert where in project["urls"].values()


# --- the example ------------------------------------------------------------------------------------------------------


def test_the_page_of_own_robots_shows_the_example_that_is_in_the_tree():
    assert fences((DOCS / "guides" / "own-robots.md").read_text(), "python") == [
        (ROOT / "examples" / "ten_lines.py").read_text()
    ]


def test_robots_stand_where_the_page_of_scenarios_places_them(capsys):
    """Robot 6, in the middle, hears both clusters, and the clusters do not hear each other."""
    (example,) = (
        each
        for each in fences((ROOT / "docs" / "reference" / "scenarios.md").read_text(), "python")
        if "places_m" in each
    )
    made: dict[str, Any] = {}
    exec(example, made)
    assert "'robot': 6" in (out := capsys.readouterr().out)
    assert re.search(r"'safe_mode_s': 1\d\.", out)
    assert "correct robots stopped: [] []" in out
    heard = made["run"].world.fleet.peer_id
    assert {int(each) for each in heard[0] if each} == {2, 3, 4, 5, 6}
    assert {int(each) for each in heard[5] if each} == {*range(1, 12)} - {6}


@pytest.mark.waits
async def test_the_example_serves_a_visitor_and_ends_at_ctrl_c(tmp_path):
    port = free_port()
    url = f"mqtt://127.0.0.1:{port}"
    with bare_mosquitto(port, free_port(), tmp_path) as (start, _):
        start()
        example = await asyncio.create_subprocess_exec(
            sys.executable, ROOT / "examples" / "ten_lines.py", url, stdout=asyncio.subprocess.PIPE
        )
        try:
            link = (await asyncio.wait_for(example.stdout.readline(), 60)).decode().strip()
            async with QrkeyClient(link, broker=url) as visitor:
                assert [robot["address"] for robot in await visitor.request(0)] == ["ROBOT-1", "ROBOT-2"]
                heard = visitor.notifications()
                await visitor.command("ROBOT-9", "move_raw", {"left_y": 1, "right_y": 1})
                await visitor.command("ROBOT-1", "move_raw", {"left_y": "fast", "right_y": 1})
                await visitor.command("ROBOT-1", "move_raw", {"left_y": 60, "right_y": -40})
                told = await asyncio.wait_for(anext(heard), 30)
                assert told == {"driven": "ROBOT-1", "wheels": [60, -40]}
                await visitor.command("ROBOT-1", "move_raw", {"left_y": 0, "right_y": 0})
                await asyncio.wait_for(anext(heard), 30)
                wheels = [tuple(robot["wheels"].values()) for robot in await visitor.request(0)]
                assert wheels == [(60, -40), (0, 0)], "it shows after a stop"
            example.send_signal(signal.SIGINT)
            assert await asyncio.wait_for(example.wait(), 30) == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                example.kill()
            await example.communicate()  # to the end of the pipe, so that it closes before the event loop


@pytest.mark.waits
async def test_own_robots_stand_behind_the_whole_gateway():
    example = await asyncio.create_subprocess_exec(
        sys.executable, ROOT / "examples" / "own_swarm.py", stdout=asyncio.subprocess.PIPE
    )
    try:
        ready = json.loads(await asyncio.wait_for(example.stdout.readline(), 60))
        async with Client(ready["qr_url"]) as visitor:
            carts = await visitor.robots()
            assert [cart["address"] for cart in carts] == ["CART-A", "CART-B"]
            await visitor.drive("CART-A", 100, 100, 0.5)
            (moved, _) = await visitor.robots()
            assert moved["lh2_position"]["x"] > carts[0]["lh2_position"]["x"]
        example.send_signal(signal.SIGINT)
        await asyncio.wait_for(example.communicate(), 10)
        assert example.returncode == 0
    finally:
        with contextlib.suppress(ProcessLookupError):
            example.kill()
        await example.communicate()


# --- the specification ------------------------------------------------------------------------------------------------


def test_the_table_of_keys_is_the_derivation():
    rows = {row[0]: row[1:3] for row in table(LINK, "value")}
    assert rows == {
        "topic": [pin.TOPIC_INFO.decode(), str(pin.TOPIC_BYTES)],
        "key": [pin.KEY_INFO.decode(), str(pin.KEY_BYTES)],
    }
    epoch = derive_epoch(Pin("123456789012"))
    assert f"`{epoch.topic}`" in LINK
    assert f"`{epoch.key.raw.hex()}`" in LINK
    assert len(epoch.topic) == 24


def test_the_lengths_of_pins_are_the_code_s():
    said = re.findall(r"(\d+) (?:digits )?\((\d+\.\d+) bits", LINK)
    assert [int(digits) for digits, _ in said] == [12, LinkConfig().pin_digits]
    for digits, bits in said:
        assert float(bits) == pytest.approx(int(digits) * math.log2(10), abs=0.05)
    assert "4 to 64 digits" in LINK.replace("\n", " ")
    for digits in (4, 64):
        Pin("0" * digits)
    for digits in (3, 65):
        with pytest.raises(errors.UsageError):
            Pin("0" * digits)


def test_the_grammar_of_topics_is_the_code_s():
    rows = {row[0]: row[1] for row in table(LINK, "part")}
    assert rows == {
        "address": topics.ADDRESS.pattern,
        "application": topics.APPLICATION.pattern,
        "name": topics.NAME.pattern,
        "client id": topics.CLIENT_ID.pattern,
    }


def test_the_table_of_topics_is_the_code_s():
    command = topics.CommandTopic("ADDRESS", "0", "NAME")
    made = [topics.full_topic("", "", sub) for sub in (command, "request", "notify", topics.ReplyTopic("CLIENT"))]
    written = [row[0] for row in table(LINK, "sub-topic")]
    for placeholder, word in {
        "<address>": "ADDRESS",
        "<application>": "0",
        "<name>": "NAME",
        "<client id>": "CLIENT",
    }.items():
        written = [topic.replace(placeholder, word) for topic in written]
    assert written == [topic.removeprefix("/") for topic in made]


def test_the_tables_of_errors_are_the_code_s():
    rows = {row[0].strip("`"): row[1].strip("`") for row in table(LINK, "error")}
    ours = [cls for cls in errors.PeerError.__subclasses__() if cls.__module__ == "phalanx.errors"]
    assert rows == {cls.__name__: cls.reason for cls in ours if cls is not errors.OpenError}


def test_limits_and_tolerance_are_the_code_s():
    config = LinkConfig()
    rows = {row[0].strip("`"): row[2] for row in table(LINK, "error")}
    assert f"{config.max_to_server_bytes // 1024} KiB of plaintext towards a server" in rows["TooLarge"]
    assert f"{config.max_to_client_bytes // 1024**2} MiB towards a client" in rows["TooLarge"]
    assert f"above {config.tolerance_s:g} s" in rows["Stale"]
    assert f"timestamp + {config.tolerance_s:g} s" in LINK.replace("\n", " ")
    assert f"root is `{config.root}`" in LINK
    assert config.knock_gap_s == 1
    assert "at most once a second" in LINK.replace("\n", " ")


def test_header_and_iv_are_the_code_s():
    assert f"`{jwe.HEADER.decode()}`" in LINK
    assert f"`{jwe.HEADER_SEGMENT.decode()}`" in LINK
    assert f"random {crypto.IV_BYTES}-byte IV" in LINK
    assert f"a {jwe.TAG_BYTES}-byte tag" in LINK


def test_the_parameters_of_rotation_are_the_code_s():
    config = LinkConfig()
    rows = {row[0]: row[1] for row in table(LINK, "parameter")}
    assert rows["a new pin every"] == f"{config.rotate_s:g} s"
    assert rows["both epochs are live for"] == f"{config.overlap_s:g} s"


def test_the_forms_of_the_link_are_the_code_s():
    url = QrUrl(Pin("0" * 12), "ws://host:1/mqtt", "/pydotbot", 4)
    ours, theirs = (re.search(rf"`<{name}>[#?]([^`]*)`", LINK)[1] for name in ("page", "frontend"))
    for written, made in ((ours, url.for_page("")), (theirs, url.for_foreign_page(""))):
        assert re.findall(r"(\w+)=", written) == re.findall(r"[#?&](\w+)=", made)


def test_the_vocabulary_is_the_code_s():
    text = (DOCS / "spec" / "vocabulary.md").read_text()
    by_number, over_a_session = text.split("## Over a session")
    assert [row[0] for row in table(by_number, "request")] == ["0", "1"]
    acts = OperatorDesk(None, None, None, "", print).acts
    of_gateways = ["state", "where", "compromise", "rotate"]
    names = [name for row in table(over_a_session, "request") for name in row[0].replace("`", "").split(", ")]
    assert names == [*vocabulary.REQUEST_NAMES.values(), *acts, *of_gateways, *requests_of(None)]
    assert (vocabulary.REQUEST_ROBOTS, vocabulary.REQUEST_AREA) == (0, 1)
    numbers = {int(row[0].split()[0]) for row in table(text, "cmd")}
    assert numbers == {notice.value for notice in vocabulary.Notice} | {255}
    assert f"at most {vocabulary.MAX_WAYPOINTS}," in text
    assert "({}…{} mm)".format(*vocabulary.THRESHOLD_MM) in text
    assert f"not heard for {vocabulary.QUIET_AFTER_S:g} s" in text


# --- generated parts, links, paths ------------------------------------------------------------------------------------


def test_the_generated_parts_are_what_the_code_gives():
    generate = loaded(DOCS / "generate.py")
    for name, (path, make) in generate.BLOCKS.items():
        assert path.read_text() == generate.replaced(path.read_text(), name, make()), f"run docs/generate.py: {name}"
    assert set(generate.MEANING) == set(State)


def test_a_page_without_its_markers_is_not_written():
    generate = loaded(DOCS / "generate.py")
    for text in ("", "<!-- x:begin -->", "<!-- x:begin --><!-- x:end --><!-- x:begin --><!-- x:end -->"):
        with pytest.raises(ValueError, match="not exactly one"):
            generate.replaced(text, "x", "block")


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", prose(page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@each_page()
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page.read_text())):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        found = (page.parent / path).resolve() if path else page
        assert found.exists(), target
        assert found.is_relative_to(DOCS) or not page.is_relative_to(DOCS), f"{target} is not on the site"
        assert not anchor or anchor in anchors(found), target


@each_page()
def test_files_named_in_the_text_exist(page):
    bases = [ROOT, ROOT / "src" / "phalanx"]
    for name in CODE.findall(prose(page.read_text())):
        if re.fullmatch(r"[\w./-]+/[\w.-]*", name) and name.split("/")[0] not in ("", "out"):
            assert any((base / name).exists() for base in bases), name


@each_page()
def test_tests_named_in_the_text_exist(page):
    tests = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    for name in CODE.findall(prose(page.read_text())):
        if re.fullmatch(r"test_\w+", name):
            assert f"def {name}(" in tests, name


def test_every_page_of_the_site_is_in_its_contents():
    contents = (ROOT / "mkdocs.yml").read_text()
    for page in DOCS.rglob("*.md"):
        assert str(page.relative_to(DOCS)) in contents


def test_every_decision_is_in_the_list_of_decisions_in_order():
    listed = re.findall(
        r"^\| \[(\d{4})\]\((\1-[\w-]+\.md)\) \| \S.* \|$", (DOCS / "adr" / "index.md").read_text(), re.MULTILINE
    )
    assert [name for _, name in listed] == sorted(path.name for path in (DOCS / "adr").glob("0*.md"))
    for number, name in listed:
        assert (DOCS / "adr" / name).read_text().startswith(f"# {number} ")


def test_the_site_loads_nothing_from_elsewhere():
    config = (ROOT / "mkdocs.yml").read_text()
    assert re.search(r"^  font: false$", config, re.MULTILINE)
    assert not re.search(r"https?://", config)
    # The theme fetches mermaid from a CDN for elements of class mermaid.
    assert "class: mermaid" not in config
