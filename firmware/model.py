"""Has spin search all runs of `model/rebound.pml` for one that breaks P1 or P2: `python firmware/model.py`.

Each way in which the protocol is broken on purpose must be found to break what it should: a search that could find
nothing proves nothing.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
MODEL = HERE / "model" / "rebound.pml"
DEEP = 1_000_000  # steps of the longest run that is followed
NONE_IS_LEFT = "errors: 0"


@dataclass(frozen=True)
class Search:
    """One form of the model, and whether its claim must hold."""

    what: str
    holds: bool
    options: str

    def run(self) -> tuple[str, int, float]:
        """What was found ("holds", "is broken", or why the search did not come to its end), states, seconds."""
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            words = (
                ["spin", *self.options.split(), "-a", str(MODEL)],
                # What is broken is found before an optimiser were done.
                ["gcc", "-O2" if self.holds else "-O0", "-w", "-DSAFETY", "pan.c"],
            )
            for made in words:
                subprocess.run(made, cwd=folder, check=True, stdout=subprocess.DEVNULL)
            done = subprocess.run(["./a.out", f"-m{DEEP}"], cwd=folder, check=True, capture_output=True, text=True)
        said = done.stdout + done.stderr
        states = int(re.search(r"^ *(\d+) states, stored", said, re.MULTILINE)[1])
        found = "is broken" if "assertion violated" in said else "holds" if NONE_IS_LEFT in said else "?"
        if "search depth too small" in said or ("Search not completed" in said and found == "holds"):
            found = "was not searched to the end"
        return found, states, time.monotonic() - began_s


SEARCHES = (
    Search("P1: a liar beside another", True, "-DLIAR=1"),
    Search("P1, T_val is not looked at", False, "-DLIAR=1 -DTOKENS_LAST"),
    Search("P1, one auditor counts twice", False, "-DLIAR=1 -DANY_AUDITOR"),
    Search("P1, f_max tokens are enough", False, "-DLIAR=1 -DNEEDED=F_MAX"),
    Search("P1, a request binds no log (`paper`)", False, "-DLIAR=1 -DSTALE_LOG"),
    Search("P1, a second key in one power-up", False, "-DLIAR=1 -DKEY_AGAIN"),
    Search("P2: one loss in a row on each link", True, "-DLIAR=0 -DLOSSES=1"),
    Search("P2, two losses in a row", False, "-DLIAR=0 -DLOSSES=2"),
    Search("P2, T_val 1.5 T_audit", False, "-DLIAR=0 -DLOSSES=1 -DT_VAL=3"),
)


def main() -> int:
    """Search, print a line each, and say by the exit code whether all came out as they must."""
    wrong = 0
    for search in SEARCHES:
        found, states, took_s = search.run()
        good = found == ("holds" if search.holds else "is broken")
        wrong += not good
        surprise = "" if good else "  THIS MUST NOT BE"
        sys.stdout.write(f"{search.what:40} {found:10} {states:9} states  {took_s:5.1f} s{surprise}\n")
        sys.stdout.flush()
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
