"""Measure the tables of docs/reference/attacks.md again: python scripts/attack_tables.py [NAME …]

Each attack by robots runs in the small swarm of tests/attacks/trials.py under each defence. The measured values replace
those in brackets in the page's row of the attack. A missing row is reported.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "attacks"))

from trials import Trial, attacked  # noqa: E402

from phalanx.attacks import IN_FLOCKS  # noqa: E402
from phalanx.config.defence import DEFENCES  # noqa: E402

NOTHING = 1e-6  # of metres: rounding
PAGE = ROOT / "docs" / "reference" / "attacks.md"


def cell(trial: Trial, verdict: str) -> str:
    """Return the verdict, the longest time from deviation to Safe Mode, and the damage."""
    lasted = f" {max(trial.stopped_after_s()):.1f} s" if verdict == "stopped" else ""
    harm = f"{trial.harm if trial.harm > NOTHING else 0:.3g}"
    unit = " robot" if trial.harm == 1 and trial.attack.harm.unit == "robots" else f" {trial.attack.harm.unit}"
    return f"{verdict}{lasted} ({harm}{unit})"


def row(name: str) -> str:
    """Return the table row of an attack by robots."""
    attack = IN_FLOCKS[name]
    seen = [cell(attacked(name, defence), attack.verdicts[defence]) for defence in DEFENCES]
    does = f"f_max: {attack.does}" if attack.crowd else attack.does
    return f"| `{name}` | {does} | {' | '.join(seen)} | {attack.stopped_by} |"


def main(names: list[str]) -> int:
    missing = 0
    for name in names or IN_FLOCKS:
        page, new = PAGE.read_text(), row(name)
        print(new, flush=True)
        found = re.search(rf"^\| `{name}` \|.*$", page, re.MULTILINE)
        missing += found is None
        if found:
            PAGE.write_text(page.replace(found[0], new))
    return 1 if missing else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
