"""What the checks of the trusted nodes notice: one small mistake after another, made by rule in a copy of `src/`.

`python firmware/mutate.py [--only anode.c] [--quick]`. A mistake counts as found when the vectors, the search for keys
on the stack, the tests of the nodes (TESTS) or a proof fails; `--quick` asks the first two alone. Each that none finds
is printed, and the exit code is 1 unless mutants.json says why it changes nothing: such a one is shown to what takes a
second alone.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
PROFILES = {"hardened": "hash mac bucket node snode anode hardened seal".split()}
PROFILES["paper"] = [{"hardened": "paper"}.get(each, each) for each in PROFILES["hardened"][:-1]]
SOURCES = [*PROFILES["hardened"], "paper"]
# What runs in Python, by the mistake's file. The quick proofs do not come to the sealed radio.
TESTS = {"": "test_firmware test_firmware_buckets test_firmware_oracle".split(), "seal": ["test_sealed_radio"]}
UNPROVED = ["seal", "paper"]
SANITIZED = "-O1 -fsanitize=address,undefined -fno-sanitize-recover=all"
CPU_S = 300  # a mistake may be a loop without an end
EQUIVALENT = HERE / "mutants.json"
ERRORS = re.findall(r"PHX_E_(\w+) =", (HERE / "include" / "phx.h").read_text())
NEXT = [*ERRORS[1:], ERRORS[0]]
# A pattern, and what takes its place. Each place where it fits is a mistake of its own.
RULES: dict[str, list[tuple[str, str]]] = {
    "a check is skipped": [(r"^ +(?:if|else if) \([^\n]*\)\n +(return [^;]+|break|continue);\n", "")],
    "a comparison is off by one": [
        (r" < ", " <= "),
        (r" <= ", " < "),
        (r" >= ", " > "),
        (r"(?<![->]) > (?!>)", " >= "),
    ],
    "a comparison is turned": [
        (r" == ", " != "),
        (r" != ", " == "),
        (r"!(?=[\w(])", ""),
        (r"(?<=if \()(?=error\))", "!"),
    ],
    "and is or": [(r" && ", " || "), (r" \|\| ", " && ")],
    "an operator is another": [
        (r" \+ ", " - "),
        (r" - ", " + "),
        (r" \* (?=\w)", " + "),
        (r" << ", " >> "),
        (r" >> ", " << "),
        (r" & ", " | "),
        (r" \| ", " & "),
        (r" \^ ", " | "),
        (r" ([-+|^])= ", " = "),
    ],
    "a number is one more": [(r"(?<![\w.])(\d+)u?\b(?!x)", "(\\1u + 1u)"), (r"\b(0x[0-9a-f]+)u?\b", "(\\1u + 1u)")],
    "a type is narrower": [
        (r"\((u?)int64_t\)", "(\\1int32_t)"),
        (r"\(uint32_t\)", "(uint16_t)"),
        (r"\(uint16_t\)", "(uint8_t)"),
        (r"(= (?:now|seq|t));", "\\1 & 0xffffu;"),
        (r"\bnow - [\w>.-]+", "(uint16_t)(\\g<0>)"),
        (r"(phx_put32\([^;]+)\);", "\\1 & 0xffffu);"),
        (r"(phx_put16\([^;]+)\);", "\\1 & 0xffu);"),
    ],
    "an error is another": [(rf"\bPHX_E_{name}\b", f"PHX_E_{other}") for name, other in zip(ERRORS, NEXT, strict=True)],
    "a type byte is another": [
        (r"PHX_ENTRY_(?:INPUT|RECV|SEND|ACMD)\b", "PHX_MKEY"),
        (r"\bPHX_(?:MKEY|TREQ|TOKEN|SEALED|TREQ_PAPER|AUTH_A_PAPER);", "PHX_AUTH_S;"),
        (r"\bPHX_AUTH_S,", "PHX_TOKEN,"),
    ],
    "one is taken for the other": [
        (r"\bsend_(us_per_s|capacity_us)", "audit_\\1"),
        (r"\baudit_(us_per_s|capacity_us)", "send_\\1"),
        (r"\ba->send\b", "a->audit"),
        (r"\ba->audit\b", "a->send"),
        (r"_unicast\b", "_broadcast"),
        (r"_broadcast\b", "_unicast"),
        (r"\bauditee, auditor\b", "auditor, auditee"),
        (r"\bauditor, auditee\b", "auditee, auditor"),
    ],
    "a statement is left out": [
        (r"^ +(?:memset|memcpy|phx_\w+|shift)\([^\n]*\);\n", ""),
        (r"^ +[\w>.\[\]-]+ (?:[-+|^&]?=) [^\n]*;\n", ""),
        (r"^ +\*?\w+(?:\+\+|--);\n", ""),
    ],
}
# The size of an array: C does not look at a parameter's, and more room changes nothing.
SIZE = re.compile(r"\S|\s+(?:static )?(?:const )?uint\d+_t [^=]*\[[^]]*$")
# A case apart, at the beginning of a function that returns an error: of these parameters.
APART = r"\buint(?:16|32)_t (now|t|auditee|auditor|id|seq|len|src)\b"


@dataclass(frozen=True)
class Mutant:
    """One mistake: what stands at these places of a file's text, and what stands there instead."""

    file: str
    rule: str
    begin: int
    end: int
    instead: str
    line: int
    was: str
    becomes: str

    @property
    def name(self) -> str:
        """Where it is and what it is, as mutants.json has it; without a line's number, which moves."""
        return f"{self.file}.c: {self.rule}: {self.was}" + (f" -> {self.becomes}" if self.becomes else "")


def mutants(file: str) -> Iterator[Mutant]:
    """All mistakes that the rules make in a source; of several with one name the second has (2) behind it."""
    text = (HERE / "src" / f"{file}.c").read_text()
    comments = [match.span() for match in re.finditer(r"/\*.*?\*/|#[^\n]*", text, re.DOTALL)]
    seen: dict[str, int] = {}
    for rule, begin, end, instead in _places(text):
        if any(a <= begin < b for a, b in comments):
            continue
        # From the beginning of its line to the end of the last.
        first, last = text.rfind("\n", 0, begin) + 1, text.find("\n", end - 1 if end > begin else end)
        if rule == "a number is one more" and SIZE.match(text[first:begin]):
            continue
        was, becomes = text[first:last], text[first:begin] + instead + text[end:last]
        mutant = Mutant(
            file, rule, begin, end, instead, text.count("\n", 0, begin) + 1, _one_line(was), _one_line(becomes)
        )
        seen[mutant.name] = seen.get(mutant.name, 0) + 1
        if seen[mutant.name] > 1:
            mutant = replace(mutant, was=f"{mutant.was} ({seen[mutant.name]})")
        yield mutant


def _places(text: str) -> Iterator[tuple[str, int, int, str]]:
    """A rule, where it changes the text, and what stands there then."""
    for rule, replacements in RULES.items():
        for pattern, instead in replacements:
            for match in re.finditer(pattern, text, re.MULTILINE):
                yield rule, match.start(), match.end(), match.expand(instead)
    for function in re.finditer(r"^(?:static )?int \w+\(([^;{]*?)\)\n\{\n", text, re.MULTILINE):
        for name in re.findall(APART, function[1]):
            for result in ("0", "PHX_E_ARG"):
                yield "a case apart", function.end(), function.end(), f"    if ({name} == 0) return {result};\n"


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))


class Bench:
    """A copy of what the checks need, in which one mistake at a time is made."""

    def __init__(self, at: Path, *, whole: bool) -> None:
        self.at = at
        for name in ("firmware", "phalanx_compiler", "release", "src", "tests", "vectors"):
            shutil.copytree(
                ROOT / name, at / name, ignore=shutil.ignore_patterns("build", "node_modules", "*.so", "pages")
            )
        for name in ("setup.py", "pyproject.toml", "README.md"):
            shutil.copy(ROOT / name, at / name)
        for profile in PROFILES:
            self._run([sys.executable, "vectors.py", profile], self.at / "firmware", f"{profile}.txt")
        if by := "".join(self._found(file, whole, proofs=False) for file in ("", "seal", "paper")):
            sys.exit(f"there is a mistake before any was made: {by}")

    def _run(self, words: list[str], where: Path, into: str = "") -> bool:
        # What is compiled anew for each mistake is not worth optimizing.
        env = {**os.environ, "PYTHONPATH": str(self.at / "src"), "PYTHONDONTWRITEBYTECODE": "", "CFLAGS": "-O0"}
        done = subprocess.run(
            words, cwd=where, check=False, capture_output=True, text=True, env=env, preexec_fn=_bounded
        )
        if into:
            (where / into).write_text(done.stdout)
        return done.returncode == 0

    def found_by(self, mutant: Mutant, whole: bool, proofs: bool) -> str:
        """Which check finds it: "" none, "compiler" where it is no program at all; `whole`: the slow ones too."""
        path = self.at / "firmware" / "src" / f"{mutant.file}.c"
        text = path.read_text()
        path.write_text(text[: mutant.begin] + mutant.instead + text[mutant.end :])
        try:
            return self._found(mutant.file, whole, proofs and mutant.file not in UNPROVED)
        finally:
            path.write_text(text)

    def _made(self, program: str, flags: str, more: str, changed: str, profile: str = "hardened") -> bool:
        """Compile it; of the sources anew what is `changed`, a file's name."""
        objects, includes = [], ["-Iinclude", "-Iport", f"-Iport/{profile}"]
        for source in [*(f"src/{name}.c" for name in PROFILES[profile]), more]:
            new = Path(source).stem == changed
            objects.append(f"{program}-{'changed' if new else Path(source).stem}.o")
            if new or not (self.at / "firmware" / objects[-1]).exists():
                words = ["gcc", "-std=c99", "-w", *includes, *flags.split(), "-c", source, "-o", objects[-1]]
                if not self._run(words, self.at / "firmware"):
                    return False
        return self._run(["gcc", *flags.split(), *objects, "-o", program], self.at / "firmware")

    def _found(self, file: str, whole: bool, proofs: bool) -> str:
        firmware, profile = self.at / "firmware", "paper" if file == "paper" else "hardened"
        if not self._made(profile, SANITIZED, "port/check.c", file, profile):
            return "compiler"
        if not self._run(["sh", "-c", f"ulimit -t 10; exec ./{profile} < {profile}.txt"], firmware):
            return "vectors"
        if profile == "hardened":
            if not self._made("stack", "-O2", "port/stack.c", file):
                return "compiler"
            if not self._run(["./stack"], firmware):
                return "keys on the stack"
        if not whole:
            return ""
        if not self._run([sys.executable, "setup.py", "-q", "build_ext", "--inplace"], self.at):
            sys.exit("what the vectors' program is made of does not become a Python module: see setup.py")
        tests = [f"tests/{name}.py" for name in TESTS.get(file, TESTS[""])]
        chosen = ["-k", "not planner"]  # which wakes no node of C, and costs a minute
        if not self._run([sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider", *chosen, *tests], self.at):
            return "tests"
        if proofs and not self._run([sys.executable, "prove.py", "--jobs", "1"], firmware):
            return "proofs"
        return ""


def main() -> int:
    """Make them all, or some; print a score, and each that was not found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="those whose name begins so: node.c")
    parser.add_argument("--take", type=int, default=0, help="so many, drawn by chance; 0 is all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-proofs", action="store_true")
    parser.add_argument("--quick", action="store_true", help="vectors and the stack alone")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    every = [each for file in SOURCES for each in mutants(file) if each.name.startswith(options.only)]
    if options.take:
        every = random.Random(options.seed).sample(every, min(options.take, len(every)))  # noqa: S311
    known = json.loads(EQUIVALENT.read_text())
    score: dict[str, int] = {}
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        benches = [Bench(Path(folder) / str(i), whole=not options.quick) for i in range(options.jobs)]
        with ThreadPoolExecutor(options.jobs) as pool:

            def look(mutant: Mutant) -> tuple[Mutant, str]:
                bench = benches.pop()
                try:
                    whole = mutant.name not in known and not options.quick
                    return mutant, bench.found_by(mutant, whole, not options.no_proofs)
                finally:
                    benches.append(bench)

            for mutant, by in pool.map(look, every):
                how = by or ("changes nothing" if mutant.name in known else "NOT FOUND")
                sys.stderr.write(f"{how}: {mutant.name} (line {mutant.line})\n")
                score[how] = score.get(how, 0) + 1
                if how == "NOT FOUND":
                    missed += 1
                    sys.stdout.write(f"not found: {mutant.name} (line {mutant.line})\n")
                    sys.stdout.flush()
    counted = sum(count for by, count in score.items() if by not in ("compiler", "changes nothing"))
    sys.stdout.write(", ".join(f"{by} {count}" for by, count in sorted(score.items())) + "\n")
    sys.stdout.write(f"{counted - missed} of {counted} mistakes found\n")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
