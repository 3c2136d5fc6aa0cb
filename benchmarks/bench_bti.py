"""How much faster than real time protected swarms are simulated, on one core, and what they cannot do without.

    python benchmarks/bench_bti.py [--quick] [--json] [--write docs/performance.md]

A run counts only if no correct robot with a quorum was stopped. It is done several times, and of each simulated second,
which does the same work each time, the least counts: other programs on the machine can only add. Stages are told apart
by leaving them out: the same robots without a defence, then whole. The floor is what was counted in the run, times what
one of it takes alone: blocks hashed, blocks encrypted, and each control step decided twice, by the robot and by an
auditor. Not a byte is moved for it, so nothing that we could write is as fast. Ends with 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_radio import replay
from processes import rss_mb
from rows import Row, print_table

from phalanx.arrays import U8x1
from phalanx.bti import trusted
from phalanx.config import BtiConfig
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.bundled import flock
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import copy, put_u16
from phalanx.world.scenarios.run import Run

HERE = Path(__file__).parent
BEGIN, END = "<!-- what bench_bti.py wrote -->\n", "<!-- until here -->\n"
# Until logs are as long as they get, and checkpoints are covered, simulated seconds.
WARM_UP_S = 8.0
KB_A_ROBOT, IN_ALL_MB, FLAT, START_S, RADIO = 15.0, 1536.0, 1.5, 0.8, 20.0
MB = 1024


@dataclass(frozen=True, slots=True)
class Swarm:
    """What is timed: a grid of robots, and the least factor of real time, or None."""

    robots: int
    step_m: float
    d_m: float
    f_max: int
    limit: float | None
    seconds: int  # simulated, behind the warm-up
    times: int = 3

    @property
    def scenario(self) -> Scenario:
        bti = BtiConfig(f_max=self.f_max)
        duration_s = WARM_UP_S + self.seconds
        return Scenario(robots=self.robots, grid_step_m=self.step_m, d_m=self.d_m, duration_s=duration_s, bti=bti)

    @property
    def name(self) -> str:
        return f"{self.robots} robots at {self.step_m:g} m, f_max {self.f_max}"


SWARMS = (
    Swarm(25, 25.0, 20.0, 3, 2000.0, 40, 10),
    Swarm(324, 64.0, 64.0, 2, 300.0, 12, 10),
    Swarm(100, 4.0, 4.0, 3, 150.0, 12, 10),
    Swarm(1000, 64.0, 64.0, 2, 90.0, 8, 6),
    Swarm(10_000, 64.0, 64.0, 2, 5.0, 4, 3),
    Swarm(60_000, 64.0, 64.0, 2, None, 2, 1),
)


@dataclass(frozen=True, slots=True)
class Timed:
    """A run behind its warm-up, for each simulated second of it."""

    cpu_ms: float
    hashed: float
    encrypted: float
    steps: float
    memory_mb: float
    stopped: int
    alone: int


def timed(scenario: Scenario, times: int) -> Timed:
    """Return the least processor time of `times` runs; setting up does not count."""
    seconds = round(scenario.duration_s - WARM_UP_S)
    least = [math.inf] * seconds
    for nth in range(times):
        before_mb = rss_mb(os.getpid())
        run = Run(scenario)
        run.advance(WARM_UP_S)
        steps, (hashed, encrypted) = _steps(run), trusted.counted()
        for k in range(seconds):
            began = time.process_time()
            run.advance(WARM_UP_S + k + 1)
            least[k] = min(least[k], time.process_time() - began)
        if nth == 0:  # what a run leaves behind, the next one uses
            memory_mb = rss_mb(os.getpid()) - before_mb
    hashed_then, encrypted_then = trusted.counted()
    summary = run.summary()
    return Timed(
        cpu_ms=1000 * sum(least) / seconds,
        hashed=(hashed_then - hashed) / seconds,
        encrypted=(encrypted_then - encrypted) / seconds,
        steps=(_steps(run) - steps) / seconds,
        memory_mb=memory_mb,
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


def _decide_ns(run: Run, i: int, reading: U8x1, times: int = 100) -> float:
    """The time of a robot's control step: what a call takes beyond that of a controller that there is not."""
    fleet, out, state = run.world.fleet, run.world.work.out.copy(), run.world.fleet.state[i].copy()
    rob_id, step, size = (int(fleet.robot[i][name]) for name in ("id", "step", "state_len"))

    def calls(controller: int) -> None:
        for k in range(times):
            copy(state, 0, fleet.state[i], 0, size)
            dispatch.on_input(controller, fleet.params, rob_id, step + k, 0, reading, reading.size, state, out)

    flock, none = int(fleet.settings[0].controller), 0
    return least_ns(lambda: calls(flock), times) - least_ns(lambda: calls(none), times)


@dataclass(frozen=True, slots=True)
class Primitives:
    """What one of each takes alone, ns: a block hashed, a block encrypted, a control step with 24 neighbours known."""

    hash_ns: float
    encrypt_ns: float
    step_ns: float


def primitives() -> Primitives:
    """Of this machine."""
    trusted.host_use(trusted.HARDENED, 1)
    long, key, told = np.zeros(1 << 16, np.uint8), np.zeros(20, np.uint8), np.zeros(20, np.uint8)
    run = Run(replace(SWARMS[0].scenario, duration_s=WARM_UP_S))
    run.advance(WARM_UP_S)
    reading = run.world.reading[: flock.SENSOR_BYTES].copy()
    put_u16(reading, flock.ID, 13)
    return Primitives(
        least_ns(lambda: trusted.sha1(long, long.size, told), long.size // 64),
        least_ns(lambda: trusted.lightmac(key, long, 1791, told), 256),
        _decide_ns(run, 12, reading),
    )


def rows_of(swarm: Swarm, alone: Primitives) -> list[Row]:
    """The CPU time, by stage, beside the floor of the same run."""
    told = timed(swarm.scenario, swarm.times)
    note = f"{swarm.seconds} s, each the least of {swarm.times}; correct robots stopped {told.stopped}, "
    note += f"without quorum {told.alone}"
    plain = timed(replace(swarm.scenario, defence="none"), swarm.times).cpu_ms
    hashing, encrypting = told.hashed * alone.hash_ns / 1e6, told.encrypted * alone.encrypt_ns / 1e6
    deciding = 2 * told.steps * alone.step_ns / 1e6
    floor = hashing + encrypting + deciding
    parts = (
        ("bodies, controllers, radio", plain, "without a defence"),
        ("trusted nodes, logs and audits", told.cpu_ms - plain, "what the defence adds"),
        ("floor: hashing", hashing, f"{told.hashed / swarm.robots:.0f} blocks a robot"),
        ("floor: encrypting", encrypting, f"{told.encrypted / swarm.robots:.0f} blocks a robot"),
        ("floor: deciding", deciding, f"{2 * told.steps / swarm.robots:.0f} steps a robot"),
    )
    large = swarm.robots >= 1000
    kb_a_robot = told.memory_mb * MB / swarm.robots
    return [
        Row(
            section=1,
            what=swarm.name,
            measured=0.0 if told.stopped else 1000 / told.cpu_ms,
            unit="x real time",
            limit=swarm.limit,
            at_least=True,
            note=note,
        ),
        *(Row(section=0, what=f"  {what}", measured=ms, unit="ms/s", note=said) for what, ms, said in parts),
        Row(section=0, what="  times the floor", measured=told.cpu_ms / floor, unit=""),
        Row(section=0, what="  memory", measured=kb_a_robot, unit="kB/robot", limit=KB_A_ROBOT if large else None),
    ]


def rows_of_all(rows: list[Row]) -> list[Row]:
    """What several swarms say together, and what is no swarm's."""
    factor = {swarm.robots: row.measured for swarm in SWARMS for row in rows if row.what == swarm.name}
    peak_mb = max(swarm.robots for swarm in SWARMS) * rows[-1].measured / MB
    grown = (factor[1000] * 1000) / (factor[10_000] * 10_000) if factor[10_000] else math.inf
    return [
        Row(section=1, what="cost of a robot, 10 000 over 1000", measured=grown, unit="times", limit=FLAT),
        Row(section=1, what="memory of 60 000 robots", measured=peak_mb, unit="MB", limit=IN_ALL_MB),
        Row(
            section=1,
            what="radio alone, 324 robots at 4 m",
            measured=radio(),
            unit="x real time",
            limit=RADIO,
            at_least=True,
        ),
        Row(section=1, what="phalanx sim run flock-12 --duration 1", measured=start_s(), unit="s", limit=START_S),
    ]


def radio(seconds: int = 5) -> float:
    """The factor of real time of the radio with the traffic that ns-3 was given; the least of three."""
    least = math.inf
    for _ in range(3):
        began = time.process_time()
        replay(324, 4, seconds=seconds, audits=True)
        least = min(least, time.process_time() - began)
    return seconds / least


def start_s() -> float:
    """Processor time of the command; the least of five, of which the first finds everything on disk."""
    words = [str(Path(sys.executable).parent / "phalanx"), "sim", "run", "flock-12", "--duration", "1"]
    least = math.inf
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        least = min(least, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return least


def machine() -> str:
    """What it ran on, in a line."""
    info = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.partition(":")[2].strip() for line in info if line.startswith("model name")), platform.machine())
    does = {1: "SHA instructions", 2: "AVX2"}
    can = trusted.FIRMWARE[trusted.HARDENED][1].phx_host_can()
    able = " and ".join(word for bit, word in does.items() if can & bit) or "neither SHA instructions nor AVX2"
    load = os.getloadavg()[0]
    return (
        f"{cpu} ({os.cpu_count()} processors, of which one is used; {able}), "
        f"Linux {platform.release().split('-')[0]}, Python {platform.python_version()}, "
        f"{time.strftime('%-d %B %Y')}, "
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
        number = f"{row.measured:.0f}" if row.measured >= 1000 else f"{row.measured:.3g}"
        lines.append(f"| {what} | {number} | {row.unit} | {asked} | {row.note} |")
    return "\n".join(lines) + "\n"


def in_a_process(swarm: int) -> list[Row]:
    """The rows of a swarm from a process of its own: what another left in memory is not this one's."""
    words = [sys.executable, __file__, "--json", "--swarm", str(swarm)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [Row(**{k: v for k, v in each.items() if k != "holds"}) for each in json.loads(done.stdout)["rows"]]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the two smallest, once, and no verdict")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--swarm", type=int, help="one of them, by its number from 0")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put what was measured into this page")
    options = parser.parse_args()
    alone = primitives()
    if options.swarm is not None:
        rows = rows_of(SWARMS[options.swarm], alone)
    elif options.quick:
        rows = [row for swarm in (0, 2) for row in rows_of(replace(SWARMS[swarm], seconds=2, times=1), alone)]
    else:
        rows = [row for swarm in range(len(SWARMS)) for row in in_a_process(swarm)]
        rows += rows_of_all(rows)
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
