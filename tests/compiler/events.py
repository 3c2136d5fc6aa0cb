"""Write all events of small runs to a file: `python events.py OUT`, compiled or, with PHALANX_PURE=1, as Python."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from behaviour.observe import RUNNERS, observed
from phalanx.kernel import PURE

RUNS = [
    ("attack", {"attack": "equivocate", "at_s": 0.5, "defence": "bound", "duration_s": 5}),
    ("mission", {"mission": "delivery", "profile": "sealed", "defence": "bound", "robots": 4, "duration_s": 2}),
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


if __name__ == "__main__":
    kept = Lines()
    for runner, inputs in RUNS:
        with observed(kept):
            RUNNERS[runner](kept, **inputs)
    Path(sys.argv[1]).write_text("\n".join(kept.lines))
    print("uncompiled" if PURE else "compiled", len(kept.lines))
