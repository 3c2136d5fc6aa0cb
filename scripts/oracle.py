"""Record the simulator's behaviour as digests, check a tree against them, and find the first event that differs.

    python scripts/oracle.py list
    python scripts/oracle.py record [CASE...]             # write digests, with their inputs and this commit
    python scripts/oracle.py check [CASE... | --quick]    # run cases, compare with the digests in the repository
    python scripts/oracle.py compare TREE_A TREE_B CASE   # run a case in two checkouts, show the first difference

CASE is a name, a group (`attack`) or a pattern (`attack/*/hardened`). Without one, all run: two minutes.
`check` ends with 1 if a case differs, and names its first second and category. `compare` then shows the event itself.
Each checkout runs with its own .venv if it has one. CONTRIBUTING.md says when digests may be recorded again.
"""

from __future__ import annotations

import argparse
import os
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from itertools import zip_longest
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from behaviour.cases import Case, all_cases  # noqa: E402

DIGESTS = "tests/behaviour/digests"
# Between two samples of bodies, chains and tokens in an event stream.
PERIOD_MS = 50
CONTEXT_LINES = 4
LONGEST_HEX = 160
COMMIT_DIGITS = 12


def selected(words: list[str], *, quick: bool = False) -> list[Case]:
    """Return the named cases; without names, all or all quick ones."""
    cases = list(all_cases().values())
    if not words:
        return [case for case in cases if case.is_quick or not quick]
    found = {case.name: case for word in words for case in cases if _matches(case, word)}
    unknown = [word for word in words if not any(_matches(case, word) for case in cases)]
    if unknown:
        raise SystemExit(f"no case {unknown[0]!r}; scripts/oracle.py list shows them")
    return list(found.values())


def _matches(case: Case, word: str) -> bool:
    return word in (case.name, case.group) or fnmatchcase(case.name, word)


# --- record ---


def commit() -> str:
    """Return this tree's commit."""
    return _git("rev-parse", "HEAD").strip()[:COMMIT_DIGITS]


def is_dirty() -> bool:
    """Return whether anything but the digests differs from the commit."""
    return bool(_git("status", "--porcelain", "--", ".", f":!{DIGESTS}").strip())


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def record(cases: list[Case], *, allow_dirty: bool) -> int:
    """Run the cases and write their digests into the repository."""
    from behaviour import digest  # noqa: PLC0415 - it loads slowly

    dirty = is_dirty()
    if dirty and not allow_dirty:
        print("the tree differs from its commit: commit first, or --allow-dirty", file=sys.stderr)
        return 1
    made_by = commit() + ("-dirty" if dirty else "")
    known = list(all_cases())
    for group in dict.fromkeys(case.group for case in cases):
        recorded = digest.load(group)
        for case in (each for each in cases if each.group == group):
            began = time.perf_counter()
            recorded[case.name] = {"commit": made_by, "inputs": case.inputs, "worlds": digest.digests_of(case)}
            print(f"recorded {case.name} ({time.perf_counter() - began:.1f} s)", flush=True)
        digest.store(group, {name: recorded[name] for name in known if name in recorded})
    return 0


# --- check ---


def check(cases: list[Case]) -> int:
    """Run the cases and compare them with their digests, a line for each; return 1 if one differs."""
    from behaviour import digest  # noqa: PLC0415 - as above

    differing = 0
    for case in cases:
        began = time.perf_counter()
        try:
            found = digest.first_difference(case, digest.load(case.group).get(case.name), digest.digests_of(case))
        except Exception as error:  # noqa: BLE001 - a broken tree differs, and the other cases still run
            found = digest.Difference(case.name, f"{type(error).__name__}: {error}")
        seconds = time.perf_counter() - began
        print(f"DIFFERS {found}" if found else f"ok      {case.name} ({seconds:.1f} s)", flush=True)
        differing += found is not None
    print(f"{len(cases) - differing} of {len(cases)} cases agree", file=sys.stderr)
    return 1 if differing else 0


# --- compare ---


class StreamSink:
    """Sink that prints events as lines: world, time in us, kind, robot, bytes in hexadecimal."""

    fine = True

    def __init__(self, period_ms: int) -> None:
        self.period_us = 1000 * period_ms
        self._last: dict[tuple[int, str], list[bytes]] = {}

    def event(self, world: int, t_us: int, kind: str, robot: int, data: bytes) -> None:
        """Print one event."""
        print(world, t_us, kind, robot, data.hex() or "-")

    def rows(self, world: int, t_us: int, kind: str, rows: list[bytes]) -> None:
        """Print the robots of a sample that changed since the last one."""
        before = self._last.get((world, kind), [b""] * len(rows))
        for robot, (old, new) in enumerate(zip(before, rows, strict=True)):
            if old != new:
                self.event(world, t_us, kind, robot, new)
        self._last[world, kind] = rows


def print_events(case: Case, period_ms: int) -> int:
    """Print the event stream of a case."""
    from behaviour import observe  # noqa: PLC0415 - as above

    print("inputs", case.runner, case.inputs)
    sink = StreamSink(period_ms)
    with observe.observed(sink):
        observe.RUNNERS[case.runner](sink, **case.inputs)
    return 0


def _streaming(tree: Path, case: str, period_ms: int) -> subprocess.Popen[str]:
    own = tree / ".venv" / "bin" / "python"
    script = tree / "scripts" / "oracle.py"
    words = [own if own.exists() else sys.executable, script if script.exists() else __file__, "events", case]
    paths = [str(tree / "src"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    words += ["--period-ms", str(period_ms)]
    return subprocess.Popen(list(map(str, words)), stdout=subprocess.PIPE, text=True, env=environment, cwd=tree)


def compare(trees: list[Path], case: str, period_ms: int) -> int:
    """Run a case in two checkouts and print the first event that differs; return 1 if there is one."""
    for tree in trees:
        if not (tree / "src" / "phalanx").is_dir():
            raise SystemExit(f"{tree} is no checkout of phalanx: it has no src/phalanx")
    running = [_streaming(tree.resolve(), case, period_ms) for tree in trees]
    try:
        return _compared(trees, running)
    finally:
        for each in running:
            each.kill()
            each.wait()


def _compared(trees: list[Path], running: list[subprocess.Popen[str]]) -> int:
    events = 0
    before: deque[str] = deque(maxlen=CONTEXT_LINES)
    for lines in zip_longest(*(_lines_of(each) for each in running)):
        if lines[0] == lines[1]:
            events += 1
            before.append(lines[0])
            continue
        print(f"{events} lines agree; the last of them:")
        print("\n".join(f"  {told_as_text(line)}" for line in before))
        for tree, line in zip(trees, lines, strict=True):
            print(f"{tree}:\n  {'ends here' if line is None else told_as_text(line, whole=True)}")
        return 1
    codes = [each.wait() for each in running]
    if any(codes):
        print(f"both runs ended early, with {codes[0]} and {codes[1]}", file=sys.stderr)
        return 1
    print(f"all {events} lines agree")
    return 0


def _lines_of(process: subprocess.Popen[str]) -> Iterator[str]:
    assert process.stdout is not None, "it is a pipe"
    for line in process.stdout:
        yield line.rstrip("\n")


def told_as_text(line: str, *, whole: bool = False) -> str:
    """Return an event line in readable form: time, kind, robot's id, decoded fields, bytes."""
    words = line.split(" ")
    if words[0] == "inputs":
        return line
    world, t_us, kind, robot, digits = words
    data = b"" if digits == "-" else bytes.fromhex(digits)
    shown = digits if whole or len(digits) <= LONGEST_HEX else digits[:LONGEST_HEX] + "…"
    who = f"robot {int(robot) + 1}" if int(robot) >= 0 else "all"
    return f"{int(t_us) / 1e6:.6f} s  {kind}  {who}  world {world}  {_meaning(kind, data)}\n    bytes {shown}"


def _meaning(kind: str, data: bytes) -> str:
    if kind == "body":
        (x, y, u, v, a, b), led = struct.unpack("<6d", data[:48]), data[48:]
        return f"position ({x!r}, {y!r}), velocity ({u!r}, {v!r}), acceleration ({a!r}, {b!r}), LED {led.hex()}"
    if kind == "command":
        return f"velocity {struct.unpack('<2d', data[:16])}, acceleration {struct.unpack('<2d', data[16:])}"
    if kind == "packet":
        acknowledged, to, length, count = struct.unpack("<iiii", data[:16])
        if acknowledged >= 0:
            return f"ACK to robot {acknowledged + 1}"
        ids = [each + 1 for each in struct.unpack(f"<{max(count, 0)}i", data[16 + length :])]
        to_whom = "broadcast" if to < 0 else f"to robot {to + 1}"
        return f"{to_whom}, {length} bytes, received by {ids if count >= 0 else 'unknown'}"
    if kind == "verdict":
        return "auditor {}, auditee {}, refusal {}".format(*struct.unpack("<iii", data))
    if kind in ("audit", "radio"):
        return str(struct.unpack(f"<{len(data) // 8}q", data))
    if kind == "mission":
        return f"poses {struct.unpack('<6d', data[:48])} {data[48:].decode()}"
    return data.decode() if kind == "outcome" else ""


# --- the command ---


def _options(words: Iterable[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n", 1)[0],
        epilog=(__doc__ or "").partition("\n\n")[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    does = parser.add_subparsers(dest="does", required=True)
    does.add_parser("list", help="print the names of all cases")
    recording = does.add_parser("record", help="write digests of cases into the repository")
    recording.add_argument("cases", nargs="*", metavar="CASE")
    recording.add_argument("--allow-dirty", action="store_true", help="record a tree that differs from its commit")
    checking = does.add_parser("check", help="compare this tree with the digests")
    checking.add_argument("cases", nargs="*", metavar="CASE")
    checking.add_argument("--quick", action="store_true", help="only the cases of the ordinary test run")
    comparing = does.add_parser("compare", help="find the first event that differs between two checkouts")
    comparing.add_argument("trees", nargs=2, type=Path, metavar="TREE")
    streaming = does.add_parser("events", help="print the events of a case")
    for each in (comparing, streaming):
        each.add_argument("case", metavar="CASE")
        each.add_argument(
            "--period-ms", type=int, default=PERIOD_MS, help=f"between samples of bodies and chains ({PERIOD_MS})"
        )
    return parser.parse_args(None if words is None else list(words))


def main(words: Iterable[str] | None = None) -> int:
    """Run one subcommand and return its exit code."""
    options = _options(words)
    if options.does == "list":
        print("\n".join(f"{case.name}  {case.inputs}" for case in all_cases().values()))
        return 0
    if options.does == "record":
        return record(selected(options.cases), allow_dirty=options.allow_dirty)
    if options.does == "check":
        return check(selected(options.cases, quick=options.quick))
    (case,) = selected([options.case])[:1]
    if options.does == "compare":
        return compare(options.trees, case.name, options.period_ms)
    return print_events(case, options.period_ms)


if __name__ == "__main__":
    try:
        code = main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        code = 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    sys.exit(code)
