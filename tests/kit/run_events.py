"""Write all events of two small runs to a file, compiled: `python run_events.py OUT`. recorded_calls.py does it as Python."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from behaviour.observe import RUNNERS, observed

RUNS = [
    ("attack", {"attack": "equivocate", "at_s": 0.5, "defence": "hardened", "duration_s": 5, "scenario": "flock-12"}),
    ("mission", {"mission": "delivery", "profile": "sealed", "defence": "hardened", "robots": 4, "duration_s": 2}),
]


class Lines:
    """Keeps all events as lines."""

    period_us, fine = 50_000, True

    def __init__(self) -> None:
        self.lines: list[str] = []

    def event(self, world: int, t_us: int, kind: str, robot: int, data: bytes) -> None:
        """Keep one event."""
        self.lines.append(f"{world} {t_us} {kind} {robot} {data.hex()}")

    def rows(self, world: int, t_us: int, kind: str, rows: list[bytes]) -> None:
        """Keep one sample."""
        self.lines += [f"{world} {t_us} {kind} {robot} {data.hex()}" for robot, data in enumerate(rows)]


def events_of(runner: str, inputs: dict[str, object]) -> list[str]:
    """Return all events of one run."""
    kept = Lines()
    with observed(kept):
        RUNNERS[runner](kept, **inputs)
    return kept.lines


if __name__ == "__main__":
    Path(sys.argv[1]).write_text("\n".join(line for run in RUNS for line in events_of(*run)))
