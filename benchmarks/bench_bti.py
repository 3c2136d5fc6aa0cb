"""How much faster than real time protected swarms are simulated, on one core, and what they cannot do without.

    python benchmarks/bench_bti.py [--quick] [--json] [--write docs/performance.md]

A run counts only if no correct robot with a quorum was stopped. Stages are told apart by leaving them out: the same
robots without a defence, then whole. The floor is what was counted in the run, times what one of it takes alone: blocks
hashed, blocks encrypted, and each control step decided twice, by the robot and by an auditor. Not a byte is moved for
it, so nothing that we could write is as fast. Ends with 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
from processes import rss_mb
from rows import Row, print_table

from phalanx.bti import trusted
from phalanx.config import BtiConfig
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.bundled import flock
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import Scenario
from phalanx.wire.fields import copy, put_u16

HERE = Path(__file__).parent
BEGIN, END = "<!-- what bench_bti.py wrote -->\n", "<!-- until here -->\n"
# Until logs are as long as they get, and checkpoints are covered, simulated seconds.
WARM_UP_S = 8.0


@dataclass(frozen=True, slots=True)
class Swarm:
    """What is timed: a grid of robots, and the least factor of real time, or None."""

    robots: int
    step_m: float
    d_m: float
    f_max: int
    limit: float | None
    seconds: float  # simulated, behind the warm-up

    @property
    def scenario(self) -> Scenario:
        bti = BtiConfig(f_max=self.f_max)
        duration_s = WARM_UP_S + self.seconds
        return Scenario(robots=self.robots, grid_step_m=self.step_m, d_m=self.d_m, duration_s=duration_s, bti=bti)

    @property
    def name(self) -> str:
        return f"{self.robots} robots at {self.step_m:g} m, f_max {self.f_max}"


SWARMS = (
    Swarm(25, 25.0, 20.0, 3, 2000.0, 50.0),
    Swarm(324, 64.0, 64.0, 2, 300.0, 20.0),
    Swarm(100, 4.0, 4.0, 3, 150.0, 20.0),
    Swarm(1000, 64.0, 64.0, 2, 90.0, 8.0),
    Swarm(10_000, 64.0, 64.0, 2, 5.0, 2.0),
)


@dataclass(frozen=True, slots=True)
class Timed:
    """A run behind its warm-up, for each simulated second of it."""

    cpu_ms: float
    hashed: float
    encrypted: float
    steps: float
    kb_a_robot: float
    stopped: int
    alone: int


def timed(scenario: Scenario) -> Timed:
    """The run; setting up does not count."""
    before_mb = rss_mb(os.getpid())
    run = Run(scenario)
    run.advance(WARM_UP_S)
    steps, (hashed, encrypted) = _steps(run), trusted.counted()
    began = time.process_time()
    run.advance(scenario.duration_s)
    spent, seconds = time.process_time() - began, scenario.duration_s - WARM_UP_S
    hashed_then, encrypted_then = trusted.counted()
    summary = run.summary()
    return Timed(
        cpu_ms=1000 * spent / seconds,
        hashed=(hashed_then - hashed) / seconds,
        encrypted=(encrypted_then - encrypted) / seconds,
        steps=(_steps(run) - steps) / seconds,
        kb_a_robot=(rss_mb(os.getpid()) - before_mb) * 1024 / scenario.robots,
        stopped=len(summary["correct_in_safe_mode"]),
        alone=len(summary["without_quorum"]),
    )


def _steps(run: Run) -> int:
    return int(run.world.fleet.robot["step"].sum())


def least_ns(job: Callable[[], object], count: int) -> float:
    """The least time of many, for each of the `count` that a call does."""
    least = float("inf")
    for _ in range(200):
        began = time.perf_counter_ns()
        job()
        least = min(least, time.perf_counter_ns() - began)
    return least / count


@numba.njit(error_model="numpy")
def _decide(fleet, i, reading, out, state, times):
    controller = fleet.settings[0].controller
    robot = fleet.robot[i]
    total = 0
    for k in range(times):
        copy(state, 0, fleet.state[i], 0, robot.state_len)
        total += dispatch.on_input(
            controller, fleet.params, robot.id, robot.step + k, 0, reading, reading.size, state, out
        )
    return total


@dataclass(frozen=True, slots=True)
class Primitives:
    """What one of each takes alone, ns: a block hashed, a block encrypted, a control step with 24 neighbours known."""

    hash_ns: float
    encrypt_ns: float
    step_ns: float


def primitives() -> Primitives:
    """Of this machine."""
    trusted.host_use(trusted.BOUND, 1)
    long, key, told = np.zeros(1 << 16, np.uint8), np.zeros(20, np.uint8), np.zeros(20, np.uint8)
    run = Run(replace(SWARMS[0].scenario, duration_s=WARM_UP_S))
    run.advance(WARM_UP_S)
    reading, out = run.world.reading[: flock.SENSOR_BYTES].copy(), run.world.work.out.copy()
    state = run.world.fleet.state[12].copy()
    put_u16(reading, flock.ID, 13)
    return Primitives(
        least_ns(lambda: trusted.sha1(long, long.size, told), long.size // 64),
        least_ns(lambda: trusted.lightmac(key, long, 1791, told), 256),
        least_ns(lambda: _decide(run.world.fleet, 12, reading, out, state, 100), 100),
    )


def rows_of(swarm: Swarm, seeds: int, alone: Primitives) -> list[Row]:
    """The least CPU time of so many seeds, by stage, beside the floor of the same run."""
    told = [timed(replace(swarm.scenario, seed=seed)) for seed in range(seeds)]
    plain = min(timed(replace(swarm.scenario, seed=seed, defence="none")).cpu_ms for seed in range(seeds))
    best = min(told, key=lambda each: each.cpu_ms)
    hashing, encrypting = best.hashed * alone.hash_ns / 1e6, best.encrypted * alone.encrypt_ns / 1e6
    deciding = 2 * best.steps * alone.step_ns / 1e6
    floor = hashing + encrypting + deciding
    stopped = sum(each.stopped for each in told)
    note = f"least of {seeds}, {swarm.seconds:g} s each; correct robots stopped {stopped}, "
    note += f"without quorum {sum(each.alone for each in told)}"
    parts = (
        ("bodies, controllers, radio", plain, "without a defence"),
        ("trusted nodes, logs and audits", best.cpu_ms - plain, "what the defence adds"),
        ("floor: hashing", hashing, f"{best.hashed / swarm.robots:.0f} blocks a robot"),
        ("floor: encrypting", encrypting, f"{best.encrypted / swarm.robots:.0f} blocks a robot"),
        ("floor: deciding", deciding, f"{2 * best.steps / swarm.robots:.0f} steps a robot"),
    )
    return [
        Row(
            section=1,
            what=swarm.name,
            measured=0.0 if stopped else 1000 / best.cpu_ms,
            unit="x real time",
            limit=swarm.limit,
            at_least=True,
            note=note,
        ),
        *(Row(section=0, what=f"  {what}", measured=ms, unit="ms/s", note=said) for what, ms, said in parts),
        Row(section=0, what="  times the floor", measured=best.cpu_ms / floor, unit=""),
        Row(section=0, what="  memory", measured=max(each.kb_a_robot for each in told[:1]), unit="kB/robot"),
    ]


def machine() -> str:
    """What it ran on, in a line."""
    info = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.partition(":")[2].strip() for line in info if line.startswith("model name")), platform.machine())
    does = {1: "SHA instructions", 2: "AVX2"}
    can = trusted.FIRMWARE[trusted.BOUND][1].phx_host_can()
    able = " and ".join(word for bit, word in does.items() if can & bit) or "neither SHA instructions nor AVX2"
    load = os.getloadavg()[0]
    return (
        f"{cpu} ({os.cpu_count()} processors, of which one is used; {able}), Linux {platform.release().split('-')[0]}, "
        f"Python {platform.python_version()}, numba {version('numba')}; {time.strftime('%-d %B %Y')}, "
        f"while {load:.0f} programs wanted a processor"
    )


def told_as_markdown(rows: list[Row], alone: Primitives) -> str:
    """What goes into the page."""
    blocks = f"a block takes {alone.hash_ns:.0f} ns to hash and {alone.encrypt_ns:.0f} ns to encrypt"
    lines = [
        f"{machine()}. Alone, {blocks}, and a control step {alone.step_ns:.0f} ns.",
        "",
        "| | measured | | asked | |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        what = f"**{row.what}**" if row.section else row.what.strip()
        asked = "" if row.limit is None else f"{row.limit:g}"
        lines.append(f"| {what} | {row.measured:.3g} | {row.unit} | {asked} | {row.note} |")
    return "\n".join(lines) + "\n"


def in_a_process(swarm: int, seeds: int) -> list[Row]:
    """The rows of a swarm from a process of its own: what another left in memory is not this one's."""
    words = [sys.executable, __file__, "--json", "--swarm", str(swarm), "--seeds", str(seeds)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [Row(**{k: v for k, v in each.items() if k != "holds"}) for each in json.loads(done.stdout)["rows"]]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the two smallest, once, and no verdict")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--swarm", type=int, help="one of them, by its number from 0")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put what was measured into this page")
    options = parser.parse_args()
    Run(Scenario(robots=5, duration_s=1.0, bti=BtiConfig(f_max=1))).advance(1.0)  # compiles
    alone = primitives()
    if options.swarm is not None:
        rows = rows_of(SWARMS[options.swarm], options.seeds, alone)
    elif options.quick:
        rows = [row for swarm in (0, 2) for row in rows_of(replace(SWARMS[swarm], seconds=2.0), 1, alone)]
    else:
        rows = [row for swarm in range(len(SWARMS)) for row in in_a_process(swarm, options.seeds)]
    if options.json:
        print(json.dumps({"rows": [row.json() for row in rows]}))
    else:
        print_table(rows)
    if options.write:
        page = options.write.read_text()
        before, _, rest = page.partition(BEGIN)
        options.write.write_text(
            before + BEGIN + "\n" + told_as_markdown(rows, alone) + "\n" + END + rest.partition(END)[2]
        )
    exceeded = [row.what for row in rows if row.holds is False]
    if options.quick or options.swarm is not None:
        return 0
    for what in exceeded:
        print(f"limit missed: {what}", file=sys.stderr)
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
