"""`phalanx doctor`: check the installation, and print how to fix what is missing.

The command has to start in every state of the installation. So this module imports nothing that needs kernels, and
doctor_around.py, which checks brokers and pages, is imported after the kernels are checked.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from phalanx.binary import INSTALL_COMPILER, is_pure, load_binary
from phalanx.errors import Unavailable, UsageError
from phalanx.papers.figure import MATPLOTLIB_HINT
from phalanx_compiler.library import NoCompiler, find_compiler

from .terminal import print_json

RELEASED_S = 1_767_225_600  # 2026-01-01: a clock before this is wrong
SYNCHRONIZED = Path("/run/systemd/timesync/synchronized")


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report: the component, whether it works, its state, and a possible fix."""

    what: str
    ok: bool
    found: str
    fix: str = ""

    @property
    def state(self) -> str:
        """Return `ok`; `fix` for a defect that has to be fixed; or `-` for an optional improvement."""
        return "fix" if not self.ok else "-" if self.fix else "ok"


def doctor(
    broker: str | None,
    broker_ws: str,
    root: str,
    broker_login: Path | None,
    as_json: bool,
) -> int:
    """Print a line for each finding; return 1 if a defect has to be fixed."""
    if not broker and (broker_ws or broker_login):
        raise UsageError("--broker-ws and --broker-login without --broker", "add --broker URL")
    kernels = _kernels()
    if not kernels.ok:
        os.environ["PHALANX_PURE"] = "1"  # or the next import would raise
    around = importlib.import_module("phalanx.cli.doctor_around")
    findings = [_python(), kernels, _trusted_nodes(), _c_compiler(), _figures(), _clock()]
    findings += around.findings(broker, broker_ws, root, broker_login)
    if as_json:
        print_json({"findings": [asdict(finding) for finding in findings]})
    else:
        for finding in findings:
            click.echo(
                f"{finding.state:3}  {finding.what:22} {finding.found}" + (f"  →  {finding.fix}" if finding.fix else "")
            )
    return 0 if all(finding.ok for finding in findings) else 1


def _python() -> Finding:
    ok = sys.version_info >= (3, 11)
    return Finding("python", ok, ".".join(map(str, sys.version_info[:3])), "" if ok else "install Python 3.11 or newer")


def _kernels() -> Finding:
    if is_pure():
        return Finding("kernels", True, "uncompiled and slow, as PHALANX_PURE is set", "unset PHALANX_PURE")
    try:
        load_binary()
    except Unavailable as error:
        return Finding("kernels", False, str(error), error.hint)
    return Finding("kernels", True, "compiled, up to date")


def _trusted_nodes() -> Finding:
    missing = [
        name for name in ("_firmware_hardened", "_firmware_paper") if not importlib.util.find_spec(f"phalanx.{name}")
    ]
    if missing:
        return Finding("trusted nodes", False, f"not compiled: {' and '.join(missing)}", "make setup, or pip install .")
    return Finding("trusted nodes", True, "compiled")


def _c_compiler() -> Finding:
    try:
        return Finding("C compiler", True, " ".join(find_compiler()))
    except NoCompiler as error:
        return Finding("C compiler", True, f"{error}: your own controllers run uncompiled", INSTALL_COMPILER)


def _figures() -> Finding:
    there = importlib.util.find_spec("matplotlib") is not None
    missing = "not installed (only for figures): phalanx reproduce measures and draws nothing, mission draw fails"
    found = "matplotlib" if there else missing
    return Finding("figures", True, found, "" if there else MATPLOTLIB_HINT)


def _clock() -> Finding:
    now = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    if time.time() < RELEASED_S:
        return Finding("clock", False, now, "set it: messages more than 30 s off are refused")
    if SYNCHRONIZED.exists():
        return Finding("clock", True, f"{now}, synchronized")
    keeper = next((name for name in ("chronyc", "ntpq") if shutil.which(name)), None)
    if keeper:
        return Finding("clock", True, f"{now}, kept by {keeper}")
    return Finding("clock", True, f"{now}, not known to be synchronized: messages more than 30 s off are refused")
