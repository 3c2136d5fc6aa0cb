"""`make release`: everything of a release but the upload, from what is committed.

It builds twice, in folders of different names, and compares bytes; looks into the wheel; and installs it into fresh
environments outside the project, where `phalanx up` has to show its code in seconds, and robots that have shields.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).resolve().parent.parent
TOOLS = Path(sys.executable).parent
PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14")
CODE_WITHIN_S = 5.0
TAG = re.compile(r"-cp311-abi3-manylinux[\w.]+\.whl$")


@dataclass(frozen=True)
class Machine:
    """A Python and the file system around it: ours, or that of another Debian."""

    python: str
    root: Path = Path("/")

    def __str__(self) -> str:
        return self.python if self.root == Path("/") else f"{self.python} in {self.root}"

    def inside(self, *command: str) -> list[str]:
        """How a command is run there; the first word is a path of it."""
        return [*command] if self.root == Path("/") else ["chroot", str(self.root), *command]


def main() -> None:
    """Do it all, and say what was done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--python", action="append", help=f"To install into; repeatable.  [default: those of {PYTHONS}]"
    )
    parser.add_argument(
        "--root", action="append", type=Path, default=[], help="Another Debian, whose Python is tried too; repeatable."
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "release")
    wanted = parser.parse_args()
    machines = [Machine(name) for name in wanted.python or [name for name in PYTHONS if runs(name)]]
    machines += [Machine(python_of(root), root) for root in wanted.root]
    if not (ROOT / ".git").exists():
        raise SystemExit("error: a release is made from a git checkout")
    shutil.rmtree(wanted.out, ignore_errors=True)
    wanted.out.mkdir(parents=True)
    os.environ["PATH"] = f"{TOOLS}:{os.environ['PATH']}"  # auditwheel looks for patchelf there
    os.environ["SOURCE_DATE_EPOCH"] = output("git", "-C", str(ROOT), "log", "-1", "--format=%ct").strip()
    if output("git", "-C", str(ROOT), "status", "--porcelain"):
        say("note: what is not committed is not in it")
    with tempfile.TemporaryDirectory(prefix="phalanx-release-") as temporary:
        folder = Path(temporary)
        wheel, sdist = build_twice(folder, wanted.out)
        look_into(wheel, sdist)
        for machine in machines:
            try_in(machine, wheel)
    for file in sorted(wanted.out.iterdir()):
        say(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file}")
    say(f"tried on {', '.join(map(str, machines)) or 'no Python'}; nothing was uploaded")


def build_twice(folder: Path, out: Path) -> tuple[Path, Path]:
    """The wheel and the source distribution in `out`; the wheel of either way is the same to the byte."""
    made = []
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", "HEAD"], capture_output=True, check=True).stdout
    for name, form in (("one", []), ("another/of-a-longer-name", ["--wheel"])):
        checkout, dist = folder / name, folder / f"dist-{len(made)}"
        checkout.mkdir(parents=True)
        subprocess.run(["tar", "x", "-C", str(checkout)], input=archive, check=True)
        how = "source distribution, and the wheel from that" if not form else "wheel, from a checkout"
        say(f"building the {how}, in {checkout}")
        output(str(TOOLS / "python"), "-m", "build", *form, "--outdir", str(dist), str(checkout))
        linux = next(dist.glob("*.whl"))
        repaired = dist / "repaired"
        output(str(TOOLS / "auditwheel"), "repair", "--wheel-dir", str(repaired), str(linux))
        made.append(next(repaired.glob("*.whl")))
    one, other = made
    check(one.name == other.name and one.read_bytes() == other.read_bytes(), "both wheels are the same to the byte")
    sdist = next((folder / "dist-0").glob("*.tar.gz"))
    return Path(shutil.copy(one, out)), Path(shutil.copy(sdist, out))


def look_into(wheel: Path, sdist: Path) -> None:
    """Whatever a stranger needs is inside, and nothing of where it was built."""
    check(bool(TAG.search(wheel.name)), f"{wheel.name} is for every Python from 3.11 on")
    with ZipFile(wheel) as archive:
        names = archive.namelist()
        inside = {name: archive.read(name) for name in names}
    for page in ("visitor", "operator", "viewer"):
        check(f"phalanx/gateway/pages/{page}/index.html" in inside, f"the {page}'s page is inside")
    # Who writes a controller of their own compiles it with the same compiler.
    wanted = {"phalanx/_kernels.abi3.so", "phalanx_compiler/runtime.h"}
    check(wanted <= inside.keys(), "the compiled kernels and their compiler are inside")
    bill = next((name for name in names if name.endswith(".dist-info/sboms/phalanx-swarm.cdx.json")), "")
    check(bool(bill) and len(json.loads(inside[bill])["components"]) > 50, "its bill of materials is inside")
    traces = [name for name, data in inside.items() if b"phalanx-release-" in data or b"/root/" in data]
    check(not traces, f"nothing says where it was built {traces or ''}")
    output(str(TOOLS / "abi3audit"), "--strict", str(wheel))
    say("ok   abi3audit: the stable interface alone is used")
    output(str(TOOLS / "twine"), "check", "--strict", str(wheel), str(sdist))
    say("ok   twine check: an index shows the README")


def try_in(machine: Machine, wheel: Path) -> None:
    """A stranger's first minutes: install, ask, scan."""
    version = output(*machine.inside(machine.python, "--version")).split()[1]
    with tempfile.TemporaryDirectory(prefix="phalanx-release-", dir=machine.root / "tmp") as temporary:
        shutil.copy(wheel, temporary)
        there = Path(temporary)  # outside the project
        home = "/" / there.relative_to(machine.root)
        env = {**os.environ, "HOME": str(home)}
        env.pop("PYTHONPATH", None)
        output(*machine.inside(machine.python, "-m", "venv", f"{home}/venv"), cwd=there, env=env)
        pip = machine.inside(f"{home}/venv/bin/pip", "install", "--quiet", "--only-binary", ":all:")
        output(*pip, f"{home}/{wheel.name}", cwd=there, env=env)
        phalanx = machine.inside(f"{home}/venv/bin/phalanx")
        said = [output(*phalanx, word, cwd=there, env=env).splitlines()[0] for word in ("--version", "doctor")]
        say(f"ok   Python {version}: {', '.join(said)}")
        scan([*phalanx, "up", "--port", "0"], f"Python {version}", there, env)


def scan(up: list[str], where: str, cwd: Path, env: dict[str, str]) -> None:
    """Start a swarm, look at its code, its page and its shields, and end it."""
    began_s = time.monotonic()
    with subprocess.Popen(
        up, cwd=cwd, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as running:
        assert running.stdout is not None, "it is a pipe"
        shown = operator = token = ""
        for line in running.stdout:
            if found := re.match(r"operator  (http://\S+)#token=(\w+)", line):
                operator, token = found.groups()
            elif found := re.match(r"visitors.*  (http://\S+)#", line):
                shown = found[1]
            elif shown and set(line) & set("█▀▄"):
                break
        took_s = time.monotonic() - began_s
        check(bool(shown), f"{where}: the code is shown")
        with urllib.request.urlopen(shown) as answer:  # noqa: S310 - http, as was matched
            check(b"<script" in answer.read(), f"{where}: the page answers")
        asked = urllib.request.Request(f"{operator}api/state", headers={"Authorization": f"Bearer {token}"})  # noqa: S310
        with urllib.request.urlopen(asked) as answer:  # noqa: S310 - as above
            check(bool(json.load(answer)["shields"]), f"{where}: robots have shields")
        running.send_signal(signal.SIGINT)
        running.stdout.read()
    check(running.returncode == 0, f"{where}: Ctrl-C ends it")
    check(took_s <= CODE_WITHIN_S, f"{where}: the code was there after {took_s:.1f} s")


def python_of(root: Path) -> str:
    """The newest Python that we promise and another Debian has."""
    found = [name for name in PYTHONS if (root / "usr/bin" / name).exists()]
    if not found:
        raise SystemExit(f"error: no Python from 3.11 on in {root}/usr/bin")
    return f"/usr/bin/{found[-1]}"


def runs(python: str) -> bool:
    """Whether there is such an interpreter; a shim of an absent one is none."""
    try:
        return subprocess.run([python, "--version"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def output(*command: str, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    """What a command prints; where it fails, all it said."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=env)
    if done.returncode:
        raise SystemExit(f"{done.stdout[-3000:]}{done.stderr[-3000:]}\nerror: {' '.join(command)} failed")
    return done.stdout


def check(holds: bool, what: str) -> None:
    """Go on if it holds."""
    if not holds:
        raise SystemExit(f"error: does not hold: {what}")
    say(f"ok   {what}")


def say(words: str) -> None:
    """Tell people."""
    print(words, flush=True)


if __name__ == "__main__":
    main()
