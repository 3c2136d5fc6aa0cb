"""Replay of a robot's whole log, to find the first entry at which an honest robot's log would differ.

It uses the kernels of audits. But the log begins with the mission, and no MAC is checked: the log is as trustworthy as
its c-node. Source: RoboRebound §3.7.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from phalanx.bti import audit, log, request, rounds
from phalanx.bti.fleet import HARDENED, make_fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.kernel import reading_peer
from phalanx.robot.controllers.python_controller import Controller
from phalanx.wire.fields import get_u32, row
from phalanx.wire.table import PROOF

from .replay import replay

# Refusals that depend only on the entries up to the wrong one: a log truncated after that entry gets the same.
OF_ENTRIES = {
    Refusal.ENTRY_MALFORMED,
    Refusal.OUT_OF_ORDER,
    Refusal.INPUT_OFF_GRID,
    Refusal.INPUT_MISSING,
    Refusal.AUDIT_FRAME_LOGGED,
    Refusal.CHECKPOINT_NOT_FLUSHED,
}
ENTRIES = np.dtype([("end", "i8"), ("t_ms", "i8")])


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry or mark, at the bytes `at` to `end` of a log; `t_ms` is -1 for all but entries."""

    at: int
    end: int
    kind: int
    t_ms: int


@dataclass(frozen=True, slots=True)
class Finding:
    """The first entry that an honest log would not contain, counted from 0, and the reason."""

    entry: int
    t_ms: int
    refusal: Refusal


def entries_of(raw: bytes) -> Iterator[Entry]:
    """Yield the entries and marks of a log, up to the first that is incomplete."""
    data, at = row(raw), 0
    while at < len(raw):
        kind, _, end = map(int, log.piece_at(data, at, len(raw)))
        if kind == PROOF.tag:
            end = at + PROOF.size
        if kind == log.CUT or end > len(raw):
            return
        yield Entry(at, end, kind, -1 if kind & log.MARK else int(get_u32(data, at + log.ENTRY_T)))
        at = end


@reading_peer()
def first_dishonest_entry(
    raw: bytes, rob_id: int, t_key_ms: int, config: BtiConfig, make: Callable[[int], Controller], mission_seed: int
) -> Finding | None:
    """Return the first entry that an honest robot's log would not contain; None for an honest log.

    Args:
        raw: the log since the mission key was loaded; an incomplete entry at its end is ignored.
        t_key_ms: when the mission key was loaded, by the clock of the trusted nodes.
        make: returns a new controller for a robot's id.
        mission_seed: determines the phase of the readings.
    Raises: PeerError: a bug in phalanx, which is logged, prevents the replay.
    """
    # An array, not a list of `Entry`: a hostile log may have 64 million entries of one byte.
    entries = np.fromiter(((each.end, each.t_ms) for each in entries_of(raw)), ENTRIES)
    if not entries.size:
        return None
    no_nodes = np.zeros((1, 8), np.uint8)
    fleet = make_fleet(
        1,
        config,
        np.zeros(1),
        profile=HARDENED,
        controller=0,
        mission_seed=mission_seed,
        snode=no_nodes,
        anode=no_nodes,
    )
    work = make_work(config)
    newest = np.maximum.accumulate(entries["t_ms"])
    # The check also reads the tops in a request's header, which a log lacks, so append as many zeros.
    q = row(raw + bytes(request.HEAD_BYTES))

    def begin(count: int) -> None:
        c = work.case[0]
        c.auditee, c.at, c.end, c.waiting, c.step = rob_id, 0, entries["end"][count - 1], 0, 0
        c.newest, c.t = t_key_ms, newest[count - 1]
        c.due = t_key_ms + int(rounds.phase_of(mission_seed, rob_id, config.t_control_ms))
        work.tops[:] = 0

    def wrong(count: int) -> Refusal:
        begin(count)
        return Refusal(int(audit.check_chains(fleet, work, q)))

    count, found = len(entries), None
    refusal = wrong(count)
    if refusal in OF_ENTRIES:
        count = bisect_left(range(count), True, key=lambda n: wrong(n + 1) == refusal)
        found = Finding(count, max(int(entries["t_ms"][count]), t_key_ms), refusal)
    if count:
        begin(count)
        if replayed := replay(fleet, work, q, make(rob_id), is_claim=False):
            # The entry at which the replay differed: a wrong output, or the first entry after an output was overdue.
            number = int(np.searchsorted(entries["end"], int(work.case[0].at)))
            return Finding(number, int(entries["t_ms"][number]), Refusal(replayed))
    return found
