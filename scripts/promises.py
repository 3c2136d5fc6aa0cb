"""Check promises P1 to P4 of docs/promises.md in many runs: each attack, layout, packet loss and f_max.

    python scripts/promises.py [--attacks spoof,…] [--layouts grid,hub,line,ring,islands,hidden,…] [--f-max 1,2,3,4,5]
                               [--t-audit 2,4,8] [--loss 0,5,20] [--seeds 2] [--csv out/promises.csv] [--table]

The table shows whether these attacks break a promise in these layouts. It says nothing about other attackers: the
share of runs without a breach is not a probability.

With an even seed, as many robots are compromised as the attack needs; with an odd seed, f_max. Runs come in random
order, so that an interrupted table is a random sample. Each finished run is appended to the CSV and is not repeated;
begin another file after a change of the robot's code. The exit code is 1 if a promise was broken.

The checks. P1: no compromised robot stays active beyond its bound after its first deviation. P2: no correct robot with
a quorum is stopped; `jam` saturates the channel and is left out. P3: each active robot has had, within T_val, tokens of
so many correct robots that with all compromised ones they are f_max + 1. P4: no correct robot's log is ever full, and
no a-node sends more AUDIT airtime than its bucket allows.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import sys
import time
from bisect import bisect_left
from collections import Counter
from dataclasses import asdict, astuple, dataclass, fields, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import layouts

from phalanx.attacks import IN_FLOCKS
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.config.radio import RadioConfig
from phalanx.errors import PhalanxError, UsageError
from phalanx.lab.scorecard.flock_trial import Sent, airtime_since
from phalanx.papers.table import Table, TableFile, version
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

# Attacks of layouts.py's layouts.
LIES, NOBODY = {"hidden": "talk-over-replies", "relayed": "relay-hello"}, "nobody"
LAYOUTS = {"grid": "bti-fig9", "hub": "star-25", "line": "line-25", "ring": "ring-25", "islands": "islands-24"}
NEAR_M = (150.0, 150.0)  # the grid's goal: the paper's is too near for false states to have an effect
SATURATES = {"jam"}
PAST_THEIR_A_NODE = {"jam", "relay-hello"}
NEED_THEM = 7  # least number of other robots in a hub layout
SHOWN = 40
OF_A_GRID = "attacks, layouts and numbers are a grid that we chose, which says nothing about other attackers"


@dataclass(frozen=True, slots=True)
class Case:
    """Parameters of one run."""

    attack: str
    layout: str
    f_max: int
    t_audit_s: float
    loss_pct: float
    seed: int


@dataclass(frozen=True, slots=True)
class Row(Case):
    """Result of one run; p1 to p4 count the robots for which that promise was broken."""

    at_s: float  # beginning of the attack
    lasted_s: float
    liars: int
    deviated: int
    p1: int
    p2: int
    p3: int
    p4: int
    without_quorum: int
    who: str  # ids of robots for which a promise was broken, or without a quorum
    digest: str
    wall_s: float


TYPES = {"str": str, "int": int, "float": float}
COLUMNS = {field.name: TYPES[str(field.type)] for field in fields(Row)}
PROMISES = ("p1", "p2", "p3", "p4")


def scenario_of(case: Case) -> Scenario:
    """Return the scenario of a case; the attack begins within the first five rounds, and the run outlasts the bounds.

    T_val is 10 s, or 20 s with T_audit 8 s.
    """
    t_val_s = _times(case)["t_val_ms"] / 1000
    drawn = hashlib.sha256(repr(case).encode()).digest()[0] / 256
    at_s = round(1.0 + drawn * (min(5 * case.t_audit_s, 2 * t_val_s) - 1.0), 3)
    if case.layout in layouts.LAYOUTS:
        return _placed(case, BtiConfig(**_times(case), f_max=case.f_max), at_s)
    made = find_scenario(LAYOUTS[case.layout])
    attack = IN_FLOCKS[case.attack]
    liars = case.f_max if case.seed % 2 else attack.liars(case.f_max)
    # All robots of the hub but f_max + 2, P2's quorum, may be compromised.
    hub = 2 * case.f_max + 2 if case.layout == "hub" else 0
    bti = BtiConfig(**_times(case), f_max=case.f_max)
    return replace(
        made,
        robots=max(made.robots, hub + NEED_THEM),
        hub=hub,
        goal_m=NEAR_M if case.layout == "grid" else made.goal_m,
        seed=case.seed,
        defence="hardened",
        duration_s=round(at_s + 2.5 * t_val_s + 1.0, 3),  # a multiple of the clock's microsecond
        bti=bti,
        n_max=None,
        radio=RadioConfig(loss=case.loss_pct / 100),
        attacks=(AttackSpec(name=case.attack, at_s=at_s),) * liars,
    )


def _times(case: Case) -> dict[str, int]:
    return {"t_audit_ms": round(1000 * case.t_audit_s), "t_val_ms": round(1000 * max(10.0, 2.5 * case.t_audit_s))}


def _placed(case: Case, bti: BtiConfig, at_s: float) -> Scenario:
    """Return the run of a case with a layout of layouts.py; `hidden` and `relayed` have compromised robots."""
    liars = {"hidden": case.f_max, "relayed": min(2, case.f_max)}.get(case.layout, 0)
    # The neighbour list is no longer than P2 requires: relayed distant robots are not in range.
    n_max = case.f_max + layouts.RELAYED_NEAR - 1 if case.layout == "relayed" and case.seed % 2 else None
    lasts_s = round(max(at_s + 2.5 * bti.t_val_ms / 1000 + 1.0, 60.0), 3)
    return replace(
        find_scenario("bti-fig9"),
        name=case.layout,
        robots=layout_of(case).robots,
        grid_step_m=1.0,
        seed=case.seed,
        duration_s=layouts.COLUMN_S if case.layout == "column" else lasts_s,
        bti=bti,
        n_max=n_max,
        radio=RadioConfig(loss=case.loss_pct / 100),
        attacks=tuple(AttackSpec(name=case.attack, at_s=at_s, robot=k + 1) for k in range(liars)),
    )


def layout_of(case: Case) -> layouts.Layout:
    """Return the layout of a case; robots drive at P2's top speed, or with an odd seed at two thirds of it."""
    speed_mps = layouts.top_speed_mps(case.t_audit_s) * (2 / 3 if case.seed % 2 else 1)
    return layouts.LAYOUTS[case.layout](case.f_max, case.seed, speed_mps)


def lived(case: Case) -> Row:
    """Run a case and return its result."""
    began = time.perf_counter()
    made = scenario_of(case)
    run = Run(made)
    compromised = frozenset(run.compromised)
    told_of: list[tuple[float, int, int]] = []
    unvouched: set[int] = set()
    layout = layout_of(case) if case.layout in layouts.LAYOUTS else None
    while run.now_s < made.duration_s:
        next_s = min(made.duration_s, run.now_s + 1.0)
        layouts.drive(run, layout, next_s) if layout else run.advance(next_s)
        told_of += [
            (at_s, auditor, auditee) for at_s, auditor, auditee, why in run.new_verdicts() if why == Refusal.NONE
        ]
        unvouched |= alive_unvouched(run, compromised, told_of)
    summary = run.summary()
    liars = [robot for _, robot in sorted(run.robots.items()) if isinstance(robot, Liar)]
    correct = set(run.ids.tolist()) - compromised
    late = {liar.id for liar, told in zip(liars, summary["compromised"], strict=True) if is_late(run, liar, told)}
    stopped = set() if case.attack in SATURATES else set(summary["correct_in_safe_mode"])
    full = {robot for robot in correct if run.world.fleet.robot[robot - 1].log_full}
    poured = {i + 1 for i in range(len(run.ids)) if case.attack not in PAST_THEIR_A_NODE and over_its_bucket(run, i)}
    without = () if case.attack in SATURATES else summary["without_quorum"]
    broken = {"p1": late, "p2": stopped, "p3": unvouched, "p4": full | poured}
    return Row(
        **asdict(case),
        at_s=made.attacks[0].at_s if made.attacks else 0.0,
        lasted_s=round(run.now_s, 3),
        liars=len(liars),
        deviated=sum(liar.first_deviation_ms is not None for liar in liars),
        **{name: len(robots) for name, robots in broken.items()},
        without_quorum=len(without),
        who=" ".join(
            f"{name}:{'/'.join(map(str, sorted(robots)))}"
            for name, robots in {**broken, "q": without}.items()
            if robots
        ),
        digest=summary["digest"][:16],
        wall_s=round(time.perf_counter() - began, 2),
    )


def is_late(run: Run, liar: Liar, told: dict[str, float | None]) -> bool:
    """Return whether P1 was broken."""
    deviated_s, safe_s = told["first_deviation_s"], told["safe_mode_s"]
    if deviated_s is None:
        return False
    bound_s = run.scenario.bti.stop_bound_ms(output_missing=liar.output_missing) / 1000
    return (run.now_s if safe_s is None else safe_s) > deviated_s + bound_s


def alive_unvouched(run: Run, compromised: frozenset[int], told_of: list[tuple[float, int, int]]) -> set[int]:
    """Return the active robots, after their grace, with tokens of too few correct robots.

    `told_of`, in ascending time, loses entries that are too old to count again.
    """
    bti = run.scenario.bti
    since_s = run.now_s - (bti.t_val_ms + bti.p_check_ms) / 1000
    if since_s <= 0:
        return set()
    del told_of[: bisect_left(told_of, (since_s,))]
    found: dict[int, set[int]] = {robot: set() for robot in run.ids[~run.in_safe_mode].tolist()}
    for _, auditor, auditee in told_of:
        if auditor not in compromised and auditee in found:
            found[auditee].add(auditor)
    needed = {robot: bti.tokens_needed - len(compromised) + (robot in compromised) for robot in found}
    return {robot for robot, auditors in found.items() if len(auditors) < needed[robot]}


def over_its_bucket(run: Run, i: int) -> bool:
    """Return whether a robot's a-node sent more AUDIT airtime than its bucket allows."""
    used = airtime_since(run, i, Sent(0.0, 0.0, 0.0))
    return used.used_s > used.bucket_s


def cases_of(said: argparse.Namespace) -> list[Case]:
    """Return all requested runs, in random order within each seed. Raises: UsageError: a value is invalid."""
    attacks = said.attacks.split(",") if said.attacks else list(IN_FLOCKS)
    places = said.layouts.split(",")
    for words, known in ((attacks, IN_FLOCKS), (places, {**LAYOUTS, **layouts.LAYOUTS})):
        if unknown := [word for word in words if word not in known]:
            raise UsageError(f"no {unknown[0]!r}", f"one of {', '.join(known)}")
    numbers = [[kind(word) for word in words.split(",")] for kind, words in
               ((int, said.f_max), (float, said.t_audit), (float, said.loss))]  # fmt: skip
    seeds = range(said.first, said.first + said.seeds)
    # Layouts of layouts.py have their own attack, or none.
    pairs = {
        (LIES.get(each, NOBODY) if each in layouts.LAYOUTS else name, each) for name, each in product(attacks, places)
    }
    cases = [Case(*pair, *each) for pair in sorted(pairs) for each in product(*numbers, seeds)]
    for case in {replace(case, seed=0) for case in cases}:
        scenario_of(case)
    # Reversed: the first byte sets the beginning of the attack, and an interrupted table must be a sample of that.
    return sorted(cases, key=lambda case: (case.seed // 2, hashlib.sha256(repr(case).encode()).digest()[::-1]))


def rows_in(file: TableFile) -> list[Row]:
    """Return the rows of a file."""
    return [Row(*(kind(word) for kind, word in zip(COLUMNS.values(), words, strict=True)))
            for _, words in file.table.lines]  # fmt: skip


def case_of(row: Row) -> Case:
    """Return the parameters of a row."""
    return Case(*(getattr(row, field.name) for field in fields(Case)))


def live(cases: list[Case], file: TableFile, workers: int) -> list[Row]:
    """Run cases, append each result to the file, and return the results, also after Ctrl-C."""
    rows: list[Row] = []
    # Only this process handles Ctrl-C; leaving the block ends the others.
    with get_context("spawn").Pool(workers, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        try:
            for row in pool.imap_unordered(lived, cases):
                rows.append(row)
                file.append_line(map(str, astuple(row)))
                if row.who:
                    print(told(row), flush=True)
                print(f"\r{len(rows)}/{len(cases)}", end="", file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            print(f"\nstopped; {len(cases) - len(rows)} of {len(cases)} runs are left", file=sys.stderr)
    return rows


def told(row: Row) -> str:
    """Return a run's result as one line."""
    return (
        f"{row.attack} {row.layout} f_max {row.f_max} T_audit {row.t_audit_s:g} s loss {row.loss_pct:g} % "
        f"seed {row.seed}, {row.liars} from {row.at_s:g} s: {row.who}"
    )


def print_table(rows: list[Row]) -> bool:
    """Print the results by each parameter; return whether a promise was broken."""
    for name in ("layout", "f_max", "t_audit_s", "loss_pct", "liars", "attack"):
        print(
            f"\n{name:18}{'runs':>7}{'P1':>5}{'P2':>5}{'P3':>5}{'P4':>5}{'no quorum':>11}  runs in which it was broken"
        )
        for value in sorted({getattr(row, name) for row in rows}):
            group = [row for row in rows if getattr(row, name) == value]
            counts = Counter(
                {each: sum(getattr(row, each) > 0 for row in group) for each in (*PROMISES, "without_quorum")}
            )
            print(f"{value!s:18}{len(group):7}" + "".join(f"{counts[each]:5}" for each in PROMISES)
                  + f"{counts['without_quorum']:11}")  # fmt: skip
    broken = [row for row in rows if any(getattr(row, each) for each in PROMISES)]
    print(f"\n{len(rows)} runs, {len(broken)} broke a promise; {OF_A_GRID}")
    for row in broken[:SHOWN]:
        print(told(row))
    return bool(broken)


def main() -> int:
    """Run the requested cases that are not in the file yet, and print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attacks", help="names, separated by commas [all]")
    parser.add_argument("--layouts", default=",".join((*LAYOUTS, *layouts.LAYOUTS)))
    parser.add_argument("--f-max", default="1,2,3,4,5")
    parser.add_argument("--t-audit", default="2,4,8", help="seconds")
    parser.add_argument("--loss", default="0,5,20", help="lost receptions, percent")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--csv", type=Path, default=Path("out/promises.csv"))
    parser.add_argument("--table", action="store_true", help="print the table of the CSV without running anything")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    said = parser.parse_args()
    try:
        asked = cases_of(said)
    except (UsageError, ValueError) as error:
        parser.error(str(error))
    head = Table(figure="promises", columns=tuple(COLUMNS), origin={"version": version()}, by_line=True)
    with TableFile(said.csv, head) as file:
        before = rows_in(file)
        known = {case_of(row) for row in before}
        left = [] if said.table else [case for case in asked if case not in known]
        rows = before + (live(left, file, min(said.workers, len(left))) if left else [])
    wanted = set(asked)
    return int(print_table([row for row in rows if said.table or case_of(row) in wanted]))


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except PhalanxError as error:
        raise SystemExit(f"{error}\n{getattr(error, 'hint', '')}") from error
