"""Measure how much more airtime audits use while compromised robots make robots seek auditors.

    python benchmarks/bench_seeking.py [--seeds 10] [--json]

Each run of scripts/layouts.py's `hidden` and `relayed` is repeated without its attack. Counted are the audit packets of
the correct robots nearby, retries included, in one minute with T_audit 4 s. docs/promises.md has the result.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
import layouts
import promises

from phalanx.world.radio.channel import AIRTIME_US, AUDIT_BROADCAST, AUDIT_UNICAST
from phalanx.world.scenarios.run import Run

LASTS_S, T_AUDIT_S, FIRST = 60.0, 4.0, 2400


def audit_share(case: promises.Case, attacked: bool) -> float:
    """Return the share of the channel, 0 to 1, that audit packets of the correct robots nearby use in one run."""
    made = promises.scenario_of(case)
    liars = len(made.attacks)
    run = Run(replace(made, duration_s=LASTS_S, attacks=made.attacks if attacked else ()))
    layouts.drive(run, promises.layout_of(case), LASTS_S)
    last = case.f_max + layouts.RELAYED_NEAR if case.layout == "relayed" else len(run.ids)
    spent_us = run.world.air.counts[liars:last, (AUDIT_BROADCAST, AUDIT_UNICAST), AIRTIME_US].sum()
    return float(spent_us) / 1e6 / LASTS_S


def main() -> int:
    """Print a row per layout and f_max."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    said = parser.parse_args()
    rows = []
    for layout in ("hidden", "relayed"):
        for f_max in (1, 3, 5):
            cases = [
                promises.Case(promises.LIES[layout], layout, f_max, T_AUDIT_S, 0.0, seed)
                for seed in range(FIRST, FIRST + said.seeds)
            ]
            quiet, attacked = (sum(audit_share(case, each) for case in cases) / len(cases) for each in (False, True))
            rows.append({"layout": layout, "f_max": f_max, "quiet": quiet, "attacked": attacked})
            if not said.json:
                more = attacked / quiet - 1
                print(f"{layout:8} f_max {f_max}: {quiet:.2%} of the channel, attacked {attacked:.2%}: {more:+.1%}")
    if said.json:
        print(json.dumps(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
