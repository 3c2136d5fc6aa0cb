"""P1 and P2 of docs/spec/rebound.md as a long table: every attack over many seeds on 25 robots.

    nice .venv/bin/python benchmarks/bench_attacks.py [--seeds 200] [--defence bound] [--attacks spoof,hijack] [--out F]

Runs go to a CSV as they end; Ctrl-C keeps them, and the same command goes on where it stopped. Two processes at most.
Ends with 1 if a robot was stopped late, or one that lied to nobody was stopped.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import math
import signal
import statistics
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from multiprocessing import get_context
from pathlib import Path

from phalanx.experiments.attack_trial import stop_bound_s
from phalanx.robot.attacks import ATTACKS, Attack
from phalanx.sim.run import Run
from phalanx.sim.scenario import DEFENCES, AttackSpec, Scenario

ROBOTS = 25
# Rounds come every 4 s: attacks begin anywhere from the first second of grace to the fifth of them.
EARLIEST_S, LATEST_S = 1.0, 20.0
MARGIN_S = 3.0


@dataclass(frozen=True)
class Result:
    """One run; of several liars the one stopped last. Of one not stopped `after_s` is inf, of one that kept to the
    protocol NaN."""

    attack: str
    defence: str
    seed: int
    at_s: float
    after_s: float
    late: int
    correct_stopped: int
    without_quorum: int


def one_run(task: tuple[str, str, int]) -> Result:
    """An attack in a swarm of its own."""
    name, defence, seed = task
    drawn = hashlib.sha256(f"{name} {seed}".encode()).digest()[0] / 256
    at_s = EARLIEST_S + drawn * (LATEST_S - EARLIEST_S)
    liars = tuple(AttackSpec(name=name, at_s=at_s) for _ in range(ATTACKS[name].liars))
    scenario = Scenario(name="bench", robots=ROBOTS, seed=seed, defence=defence, attacks=liars)
    run = Run(scenario)
    run.advance(at_s + scenario.bti.t_val_ms / 1000 + MARGIN_S)
    told = run.summary()
    after_s, late = float("nan"), 0
    robots = [robot for _, robot in sorted(run.robots.items()) if isinstance(robot, Attack)]
    for robot, liar in zip(robots, told["compromised"], strict=True):
        if liar["first_deviation_s"] is None:
            continue
        stopped_s = float("inf") if liar["safe_mode_s"] is None else liar["safe_mode_s"]
        took_s = stopped_s - liar["first_deviation_s"]
        bound_s = stop_bound_s(scenario, output_missing=robot.output_missing)
        late += bound_s is not None and took_s > bound_s
        after_s = took_s if math.isnan(after_s) else max(after_s, took_s)
    return Result(
        name, defence, seed, at_s, after_s, late, len(told["correct_in_safe_mode"]), len(told["without_quorum"])
    )


def kept(path: Path) -> list[Result]:
    """Results of earlier runs of this command."""
    if not path.exists():
        return []
    with path.open() as file:
        return [
            Result(
                row["attack"],
                row["defence"],
                int(row["seed"]),
                *(float(row[name]) for name in ("at_s", "after_s")),
                *(int(row[name]) for name in ("late", "correct_stopped", "without_quorum")),
            )
            for row in csv.DictReader(file)
        ]


def new_results(tasks: list[tuple[str, str, int]], path: Path) -> Iterator[Result]:
    """Each is in the file before it is given."""
    fresh = not path.exists()
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        path.open("a") as file,
        get_context("spawn").Pool(min(2, len(tasks)), signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool,
    ):
        writer = csv.DictWriter(file, [field.name for field in fields(Result)])
        if fresh:
            writer.writeheader()
        for done, result in enumerate(pool.imap_unordered(one_run, tasks, chunksize=4), 1):
            writer.writerow(asdict(result))
            file.flush()
            print(f"\r{done} of {len(tasks)} runs", end="", file=sys.stderr, flush=True)
            yield result
    print(file=sys.stderr)


def table(results: Iterable[Result]) -> int:
    """Printed, with what must be 0 first; the number of runs in which it was not."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.attack, result.defence), []).append(result)
    print(
        f"{'attack':18}{'defence':9}{'verdict':13}{'runs':>5}{'stopped late':>14}{'correct stopped':>17}"
        f"{'no quorum':>11}{'median s':>10}{'max s':>8}"
    )
    wrong = 0
    for (name, defence), group in sorted(groups.items()):
        took_s = [result.after_s for result in group if not math.isnan(result.after_s)]
        late, stopped = sum(result.late for result in group), sum(result.correct_stopped for result in group)
        times = f"{statistics.median(took_s):10.2f}{max(took_s):8.2f}" if took_s else f"{'-':>10}{'-':>8}"
        verdict = ATTACKS[name].verdicts[defence]
        print(
            f"{name:18}{defence:9}{verdict:13}{len(group):5}{late:14}{stopped:17}"
            f"{sum(result.without_quorum for result in group):11}{times}"
        )
        if defence == "bound" and verdict != "not covered":
            wrong += sum(bool(result.late or result.correct_stopped) for result in group)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--defence", choices=DEFENCES, default="bound")
    parser.add_argument("--attacks", default=",".join(ATTACKS), help="names, with commas between")
    parser.add_argument("--out", type=Path, default=Path("out/attacks.csv"))
    said = parser.parse_args()
    names = said.attacks.split(",")
    if unknown := set(names) - set(ATTACKS):
        parser.error(f"no attack {', '.join(sorted(unknown))}")
    wanted = [(name, said.defence, seed) for name in names for seed in range(said.seeds)]
    results = {(result.attack, result.defence, result.seed): result for result in kept(said.out)}
    todo = [task for task in wanted if task not in results]
    interrupted = False
    if todo:
        try:
            for result in new_results(todo, said.out):
                results[result.attack, result.defence, result.seed] = result
        except KeyboardInterrupt:
            interrupted = True
            print(f"\nstopped; {said.out} has what is done, and the same command goes on", file=sys.stderr)
    wrong = table(results[task] for task in wanted if task in results)
    return 130 if interrupted else int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
