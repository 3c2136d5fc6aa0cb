"""Requests for audits as robots of a run show them; what has been shown, somebody else's takes the place of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phalanx.world.scenarios.run import Run


def requests_of(run: Run, until_s: float) -> Iterator[tuple[int, int, bytes]]:
    """Of each robot its last request in each second: auditee, auditor, bytes. They are under way for a few ms."""
    fleet = run.world.fleet
    seen = fleet.robot["request_no"].copy()
    last: dict[int, tuple[int, int, bytes]] = {}
    for ms in range(1, round(until_s * 1000) + 1):
        run.advance(ms / 1000)
        for i in np.flatnonzero((fleet.robot["request_no"] != seen) & (fleet.robot["request_len"] > 0)).tolist():
            robot = fleet.robot[i]
            seen[i] = robot.request_no
            q = fleet.request.rows[robot.request_row, : robot.request_len]
            last[i] = i, int(robot.request_to) - 1, q.tobytes()
        if ms % 1000 == 0:
            yield from (last[i] for i in sorted(last))
            last.clear()
