"""What a stranger installs: the wheel has the pages, says what is in it, and nothing of where it was built."""

from __future__ import annotations

import email
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from zipfile import ZipFile

import markdown
import pytest

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "release"))

from readme import for_index  # noqa: E402
from sbom import bill_of_materials  # noqa: E402

from phalanx.cli.commands.new import TEMPLATES  # noqa: E402


class Addresses(HTMLParser):
    def __init__(self, text: str):
        super().__init__()
        self.found: list[str] = []
        self.feed(markdown.markdown(text, extensions=["fenced_code", "tables"]))

    def handle_starttag(self, tag, attrs):
        self.found += [value for name, value in attrs if name in ("href", "src")]


def test_an_index_shows_the_readme_without_links_to_files_beside_it():
    readme = (ROOT / "README.md").read_text()
    assert any(not address.startswith("https://") for address in Addresses(readme).found), "or there is nothing to do"
    shown = for_index(readme)
    assert Addresses(shown).found
    assert all(address.startswith("https://") for address in Addresses(shown).found)
    assert "the tour explains the code" in " ".join(shown.split()), "the words of a link stay"
    assert re.findall("^```.*?^```$", shown, re.MULTILINE | re.DOTALL) == re.findall(
        "^```.*?^```$", readme, re.MULTILINE | re.DOTALL
    )


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("see [a](b.md), [c](https://d/e)", "see a, [c](https://d/e)"),
        ("![x](docs/img/y.png)\n\nwords", "words"),
        ("[`a`](b.md#c) and [x](#y)", "`a` and x"),
        ('<img src="docs/a.png" alt="">\n\nwords', "words"),
        ('<img src="https://a/b.png">', '<img src="https://a/b.png">'),
        ("[![x](y.png)](z.md) words", " words"),
    ],
)
def test_what_is_relative_is_left_away(written, shown):
    assert for_index(written) == shown


def test_the_bill_of_materials_has_what_is_asked_for_and_what_is_bundled():
    bill = bill_of_materials("1.2.3")
    names = {(part["purl"].split("/")[0], part["name"]): part for part in bill["components"]}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for wanted in project["dependencies"]:
        assert ("pkg:pypi", re.match("[a-z0-9-]+", wanted)[0]) in names, wanted
    assert ("pkg:pypi", "yarl") in names, "aiohttp asks for it"
    assert not {("pkg:pypi", "pytest"), ("pkg:pypi", "matplotlib")} & names.keys()
    web = json.loads((ROOT / "web" / "package.json").read_text())
    for name, version in web["dependencies"].items():
        assert names["pkg:npm", name]["version"] == version
        assert len(names["pkg:npm", name]["hashes"][0]["content"]) == 128
    assert not {("pkg:npm", name) for name in ("vite", "vitest", "typescript", "eslint")} & names.keys()
    assert ("pkg:github", "monocypher") in names, "C of others that is compiled into ours"
    purls = [part["purl"] for part in bill["components"]]
    assert len(set(purls)) == len(purls)


def test_lock_files_name_no_registry():
    for lock in [*ROOT.glob("*.lock"), ROOT / "web" / "package-lock.json"]:
        assert not re.search(r"^--|file:|index-url|\"resolved\"", lock.read_text(), re.MULTILINE), lock.name


def test_without_a_c_compiler_the_build_fails_in_a_line(tmp_path):
    env = os.environ | {"CC": "none-such -O2"}
    build = [sys.executable, "setup.py", "--quiet", "build_ext", "--build-lib", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "error: no C compiler: none-such is not here; hint: apt-get install gcc libc6-dev, or set CC"
    ]


def test_without_a_new_enough_node_the_build_fails_in_a_line(tmp_path, monkeypatch):
    checkout = tmp_path / "release"
    shutil.copytree(ROOT / "release", checkout)
    (tmp_path / "web").mkdir()
    node = tmp_path / "bin" / "node"
    node.parent.mkdir()
    script = f"import sys; sys.path.insert(0, {str(checkout)!r}); import pages; pages.make_pages()"
    for version, said in (("v18.20.4", "v18.20.4 is here"), (None, "none is here")):
        if version:
            node.write_text(f"#!/bin/sh\necho {version}\n")
            node.chmod(0o755)
        else:
            node.unlink()
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, env={"PATH": str(node.parent)}, check=False
        )
        assert done.returncode == 1
        assert len(done.stderr.splitlines()) == 1
        assert "Node.js 20.19 or newer" in done.stderr
        assert said in done.stderr


@pytest.mark.long
def test_a_wheel_from_a_plain_checkout_has_all_a_stranger_needs(tmp_path):
    checkout, out = tmp_path / "checkout", tmp_path / "out"
    checkout.mkdir()
    names = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, check=True).stdout
    packed = subprocess.run(["tar", "c", "-C", ROOT, "--null", "-T", "-"], input=names, capture_output=True, check=True)
    subprocess.run(["tar", "x", "-C", checkout], input=packed.stdout, check=True)
    (checkout / "web" / "node_modules").symlink_to(ROOT / "web" / "node_modules")  # `make release` installs them again
    os.utime(checkout / "web" / "package-lock.json", (0, 0))  # or a build would, through this link, in a worktree
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", out, checkout]
    subprocess.run(wheel, check=True, env=os.environ | {"PYTHONPATH": ""})
    (made,) = out.iterdir()
    assert re.fullmatch(r"phalanx_swarm-[0-9.]+-cp311-abi3-linux_\w+\.whl", made.name)
    with ZipFile(made) as archive:
        inside = {entry.filename: archive.read(entry) for entry in archive.infolist()}
        assert {entry.date_time for entry in archive.infolist()} == {(2026, 1, 1, 0, 0, 0)}
        modes = {entry.filename: entry.external_attr >> 16 & 0o777 for entry in archive.infolist()}
    assert set(modes.values()) <= {0o644, 0o755, 0o664}
    info = made.name.split("-cp311")[0] + ".dist-info"
    assert {f"phalanx/gateway/pages/{page}/index.html" for page in ("visitor", "operator", "viewer")} <= inside.keys()
    assert {f"phalanx/_firmware_{name}.abi3.so" for name in ("hardened", "paper")} <= inside.keys()
    assert {f"phalanx/cli/templates/{path.name}" for path in TEMPLATES.glob("*.*")} <= inside.keys(), "phalanx new"
    assert json.loads(inside[f"{info}/sboms/phalanx-swarm.cdx.json"])["bomFormat"] == "CycloneDX"
    metadata = email.message_from_bytes(inside[f"{info}/METADATA"])
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert not any(str(tmp_path).encode() in data or str(ROOT).encode() in data for data in inside.values())
    shared = {name: data for name, data in inside.items() if name.endswith(".so")}
    nodes = inside["phalanx/trusted_node"]
    assert not any(b"/root/" in data or b"/home/" in data for data in [nodes, *shared.values()])
    assert modes["phalanx/trusted_node"] == 0o755
    assert [modes[name] for name in modes if name.endswith(".data/scripts/phalanx")] == [0o755], "some pips ask for it"
