"""Build the wheel for aarch64 with zig, and run it under QEMU: `arm64.py FOLDER sim run bti-fig9 --json`.

FOLDER stores the wheel, a Debian Python for arm64, and the wheels of the dependencies. The other arguments are a
`phalanx` command, which runs on the emulated machine. Needs qemu-user (Debian), and ziglang (PyPI) in the
Python that runs this.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).resolve().parent.parent
TARGET = "aarch64-linux-gnu.2.28"
# Python, and the libraries that it and the dependencies' wheels are linked to.
DEBIAN = (
    *["python3.11-minimal", "libpython3.11-minimal", "libpython3.11-stdlib", "libc6", "zlib1g", "libexpat1", "libssl3"],
    *["libffi8", "libbz2-1.0", "liblzma5", "libsqlite3-0", "libgcc-s1", "libstdc++6", "libuuid1", "libcrypt1"],
)
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")


def run(*command: str | Path, cwd: Path = ROOT, env: dict[str, str] | None = None) -> None:
    """Run a command. Raises: SystemExit: it failed; the message has its output."""
    done = subprocess.run(
        [str(each) for each in command],
        cwd=cwd,
        env=os.environ | (env or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{command[0]} failed: {(done.stderr or done.stdout).strip()[-2000:]}")


def build(folder: Path) -> Path:
    """Return the wheel for aarch64, built by zig."""
    compiler = folder / "zig-cc"
    compiler.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang cc -target {TARGET} "$@"\n')
    compiler.chmod(0o755)
    env = {"CC": str(compiler), "LDSHARED": f"{compiler} -shared", "_PYTHON_HOST_PLATFORM": "linux-aarch64"}
    wheels = folder / "wheel"
    options = ["--no-deps", "--no-build-isolation", "--wheel-dir", wheels]
    run(sys.executable, "-m", "pip", "wheel", "--quiet", *options, ".", env=env)
    return next(wheels.glob("*_aarch64.whl"))


def fetch_python(folder: Path) -> None:
    """Unpack Debian's Python for arm64 with a separate apt state, so that this machine's packages do not change."""
    state, packages = folder / "apt", folder / "debian"
    for each in ("lists/partial", "cache/archives/partial"):
        (state / each).mkdir(parents=True, exist_ok=True)
    (state / "status").touch()
    packages.mkdir(exist_ok=True)
    places = {"State::lists": "lists", "State::status": "status", "Cache": "cache"}
    settings = ["APT::Architecture=arm64", "APT::Architectures=arm64"]
    settings += [f"Dir::{name}={state / place}" for name, place in places.items()]
    apt = ["apt-get", "-qq", *(word for each in settings for word in ("-o", each))]
    run(*apt, "update")
    run(*apt, "download", *DEBIAN, cwd=packages)
    for package in packages.glob("*.deb"):
        run("dpkg", "-x", package, folder / "root")


def fetch_wheels(folder: Path) -> None:
    """Unpack the wheels of the dependencies, of the versions that are pinned."""
    wanted = [word for each in PLATFORMS for word in ("--platform", each)]
    options = ["--only-binary=:all:", "--python-version=3.11", "--no-deps", "--require-hashes", *wanted]
    run(
        sys.executable, "-m", "pip", "download", "--quiet", *options, "-d", folder / "wheels", "-r", "requirements.lock"
    )
    for wheel in (folder / "wheels").glob("*.whl"):
        ZipFile(wheel).extractall(folder / "site")


def set_up(folder: Path) -> None:
    """Fetch what is missing, and build the project's wheel."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "root").exists():
        fetch_python(folder)
    if not (folder / "site").exists():
        fetch_wheels(folder)
    ZipFile(build(folder)).extractall(folder / "site")


def command(folder: Path, *words: str) -> tuple[list[str], dict[str, str]]:
    """Return the command that runs `phalanx` on the emulated machine, and its environment."""
    root = folder / "root"
    python = ["qemu-aarch64", "-L", str(root), str(root / "usr/bin/python3.11")]
    return [*python, "-m", "phalanx", *words], os.environ | {"PYTHONPATH": str(folder / "site")}


def main() -> int:
    """Set up the folder, and run the command. Return its exit code."""
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(sys.argv[1]).resolve()
    set_up(folder)
    line, env = command(folder, *sys.argv[2:])
    return subprocess.run(line, env=env, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
