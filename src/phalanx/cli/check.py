"""`phalanx sim check`: whether a controller can be audited."""

from __future__ import annotations

from phalanx.sim.determinism.check import Check, check_controller

from .terminal import print_json, print_rows, said_aside


def check(controller: str, seed: int, as_json: bool) -> int:
    """Checks a controller and says on stdout where it differs; 1 if it does."""
    with said_aside():
        report = check_controller(controller, seed)
    if as_json:
        print_json(report.as_json())
    else:
        print_rows(
            {"controller": f"{report.controller}: {report.calls} calls, seed {report.seed}"}
            | {each.name: _told(each) for each in report.checks}
        )
    return 0 if report.agrees else 1


def _told(check: Check) -> str:
    return "yes" if check.finding is None else f"NO: {check.finding}"
