"""P1 and P2 of docs/spec/rebound.md as a table: every attack over many seeds on 25 robots.

    nice .venv/bin/python benchmarks/bench_attacks.py [--seeds 200] [--defence hardened] [--attacks A,B] [--out F]

What is stopped is watched until it must be; what is limited or harmless goes on for a minute, in f_max robots. With
--out runs go to a CSV as they end; Ctrl-C keeps them, and the same command goes on where it stopped. Two processes at
most. Ends with 1 if a verdict was not what was seen: a liar was stopped late, a robot that lied to nobody was stopped,
or a liar that is only limited was stopped or was on the air for longer than its bucket lets it.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import math
import signal
import statistics
import sys
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, fields
from multiprocessing import get_context
from pathlib import Path

from phalanx.attacks import IN_FLOCKS
from phalanx.config.defence import DEFENCES
from phalanx.errors import PhalanxError
from phalanx.lab.scorecard.flock_trial import airtime_since, sent, stop_bound_s
from phalanx.papers.table import Table, TableFile, version
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

ROBOTS = 25
# Rounds come every 4 s: attacks begin anywhere from the first second of grace to the fifth of them.
EARLIEST_S, LATEST_S = 1.0, 20.0
MARGIN_S = 3.0
# As long as an attack that nothing stops is watched.
LONG_S = 60.0
SAMPLE = 2
LASTING = ("limited", "harmless")


@dataclass(frozen=True)
class Result:
    """One run.

    Args:
        attack, defence, seed: which.
        version: of the program.
        at_s: the first lie.
        lasted_s: so long the lie was watched.
        liars: how many,
        deviated: how many did what an honest robot would not,
        alive: and how many were not in Safe Mode at the end.
        after_s: from deviation to Safe Mode, of the liar that took longest: inf if not stopped, NaN if none deviated.
        late: liars that took longer than P1 allows.
        correct_stopped, without_quorum: correct robots in Safe Mode; the latter had too few in range.
        bucket: of the airtime that an a-node lets out, which share the liar used that used most.
        on_air: share of the time that this one was on the air.
    """

    attack: str
    defence: str
    seed: int
    version: str
    at_s: float
    lasted_s: float
    liars: int
    deviated: int
    alive: int
    after_s: float
    late: int
    correct_stopped: int
    without_quorum: int
    bucket: float
    on_air: float


TYPES = {"str": str, "int": int, "float": float}
COLUMNS = {field.name: TYPES[str(field.type)] for field in fields(Result)}


HEAD = Table(figure="attacks", columns=tuple(COLUMNS), origin={"robots": ROBOTS}, by_line=True)


def results_in(file: TableFile) -> list[Result]:
    """Those that were there."""
    return [
        Result(*(kind(word) for kind, word in zip(COLUMNS.values(), words, strict=True)))
        for _, words in file.table.lines
    ]


def one_run(task: tuple[str, str, int, str]) -> Result:
    """An attack in a swarm of its own."""
    name, defence, seed, by = task
    kind = IN_FLOCKS[name]
    lasting = kind.verdicts[defence] in LASTING
    drawn = hashlib.sha256(f"{name} {seed}".encode()).digest()[0] / 256
    at_s = EARLIEST_S + drawn * (LATEST_S - EARLIEST_S)
    scenario = Scenario(name="bench", robots=ROBOTS, seed=seed, defence=defence)
    f_max = scenario.bti.f_max
    lasts_s = LONG_S if lasting else scenario.bti.t_val_ms / 1000 + MARGIN_S
    liars = (AttackSpec(name=name, at_s=at_s),) * (f_max if lasting else kind.liars(f_max))
    run = Run(scenario.with_options(attacks=liars))
    run.advance(at_s)
    robots = [robot for _, robot in sorted(run.robots.items()) if isinstance(robot, Liar)]
    before = [sent(run, robot.i) for robot in robots]
    run.advance(at_s + lasts_s)
    told = run.summary()
    took_s, late = [], 0
    for robot, liar in zip(robots, told["compromised"], strict=True):
        if liar["first_deviation_s"] is not None:
            stopped_s = math.inf if liar["safe_mode_s"] is None else liar["safe_mode_s"]
            took_s.append(stopped_s - liar["first_deviation_s"])
            bound_s = stop_bound_s(run.scenario, output_missing=robot.output_missing)
            late += bound_s is not None and took_s[-1] > bound_s
    used = [airtime_since(run, robot.i, then) for robot, then in zip(robots, before, strict=True)]
    return Result(
        name,
        defence,
        seed,
        by,
        at_s,
        lasts_s,
        len(robots),
        len(took_s),
        sum(liar["safe_mode_s"] is None for liar in told["compromised"]),
        max(took_s, default=math.nan),
        late,
        len(told["correct_in_safe_mode"]),
        len(told["without_quorum"]),
        max(each.used_s / each.bucket_s for each in used),
        max(each.on_air_s / each.seconds for each in used),
    )


def new_results(tasks: list[tuple[str, str, int, str]], file: TableFile | None) -> Iterator[Result]:
    """Each is in the file before it is given."""
    with get_context("spawn").Pool(min(2, len(tasks)), signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        for done, result in enumerate(pool.imap_unordered(one_run, tasks), 1):
            if file:
                file.append_line(map(str, astuple(result)))
            print(f"\r{done} of {len(tasks)} runs", end="", file=sys.stderr, flush=True)
            yield result
    print(file=sys.stderr)


def table(results: Iterable[Result]) -> int:
    """Printed, with what must be 0 first; the number of runs in which it was not."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.attack, result.defence), []).append(result)
    print(
        f"{'attack':18}{'defence':10}{'verdict':12}{'runs':>5}{'late':>6}{'correct stopped':>17}{'no quorum':>11}"
        f"{'liars':>7}{'deviated':>10}{'alive':>7}{'median s':>10}{'max s':>8}{'of bucket':>11}{'on air':>8}"
    )
    wrong = 0
    for (name, defence), group in sorted(groups.items()):
        verdict = IN_FLOCKS[name].verdicts[defence]
        took_s = [result.after_s for result in group if not math.isnan(result.after_s)]
        times = f"{statistics.median(took_s):10.2f}{max(took_s):8.2f}" if took_s else f"{'-':>10}{'-':>8}"
        bucket = f"{max(result.bucket for result in group):11.0%}" if defence == "hardened" else f"{'-':>11}"
        late, stopped, quorum, liars, deviated, alive = (
            sum(getattr(result, name) for result in group)
            for name in ("late", "correct_stopped", "without_quorum", "liars", "deviated", "alive")
        )
        print(
            f"{name:18}{defence:10}{verdict:12}{len(group):5}{late:6}{stopped:17}{quorum:11}"
            f"{liars:7}{deviated:10}{alive:7}{times}{bucket}{max(result.on_air for result in group):8.1%}"
        )
        wrong += sum(is_wrong(result, verdict) for result in group)
    runs = [result for group in groups.values() for result in group]
    print(f"{len(runs)} runs, {wrong} of them not as promised; by {', '.join(sorted({run.version for run in runs}))}")
    return wrong


def is_wrong(result: Result, verdict: str) -> bool:
    """Whether something happened that the verdict excludes; one of an attack that bites excludes nothing."""
    if verdict in ("bites", "not covered"):
        return False
    # Who left out of its log what changed nothing that it did is stopped, too.
    honest = verdict == "stopped" and result.deviated < result.liars and result.alive > 0
    over = verdict == "limited" and (result.alive < result.liars or result.bucket > 1)
    return bool(result.late or result.correct_stopped or result.without_quorum or honest or over)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SAMPLE, help="of each attack; the long table has 200")
    parser.add_argument("--defence", choices=DEFENCES, default="hardened")
    parser.add_argument("--attacks", default=",".join(IN_FLOCKS), help="names, with commas between")
    parser.add_argument("--out", type=Path, help="CSV to keep the runs in, and to go on from")
    said = parser.parse_args()
    names = said.attacks.split(",")
    if unknown := set(names) - set(IN_FLOCKS):
        parser.error(f"no attack {', '.join(sorted(unknown))}")
    by = version()
    # Seed by seed, so that a table that was stopped has something of everything.
    wanted = [(name, said.defence, seed) for seed in range(said.seeds) for name in names]
    interrupted = False
    with contextlib.ExitStack() as stack:
        file = stack.enter_context(TableFile(said.out, HEAD)) if said.out else None
        results = {(run.attack, run.defence, run.seed): run for run in (results_in(file) if file else ())}
        todo = [(*task, by) for task in wanted if task not in results]
        try:
            for result in new_results(todo, file) if todo else ():
                results[result.attack, result.defence, result.seed] = result
        except KeyboardInterrupt:
            interrupted = True
            print(f"\nstopped{f'; {said.out} has what is done' if file else ''}", file=sys.stderr)
    wrong = table(results[task] for task in wanted if task in results)
    return 130 if interrupted else int(wrong > 0)


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except PhalanxError as error:
        raise SystemExit(f"{error}\n{getattr(error, 'hint', '')}") from error
