"""Results of a scenario over several seeds, as arrays and tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.refusal import Refusal
from phalanx.errors import UsageError
from phalanx.scenarios.scenario import Scenario

Table = Literal["robots", "verdicts", "runs"]
VERDICT = np.dtype([("seed", "i8"), ("time_s", "f8"), ("auditor", "i4"), ("auditee", "i4"), ("refusal", "i4")])
# Entries of a summary that are not a single value of the run.
SERIES = (
    "distance_series",
    "compromised",
    "bytes_per_s_per_robot",
    "tried_bytes_per_s_per_robot",
    "airtime_pct_per_robot",
)


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """S runs of a scenario with N robots, sampled T times. The arrays are not shared.

    Args:
        scenario: its seed is the first run's.
        seeds: (S,) int64.
        ids: (N,) int64, of robots.
        times_s: (T,) float64, from 0, simulated seconds.
        positions_m: (S, T, N, 2) float64, world frame.
        velocities_mps: (S, T, N, 2) float64, world frame.
        in_safe_mode: (S, T, N) bool.
        compromised: (S, N) bool, robots that are compromised at some time; each seed may draw others.
        verdicts: (V,) VERDICT, each completed audit, by run and time: ids of auditor and auditee, and
            the refusal as a number of `phalanx.bti.refusal.Refusal`, 0 for a token.
        summaries: (S,), summary of each run, as printed by `phalanx sim run --json`.
    """

    scenario: Scenario
    seeds: NDArray[np.int64]
    ids: NDArray[np.int64]
    times_s: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    velocities_mps: NDArray[np.float64]
    in_safe_mode: NDArray[np.bool_]
    compromised: NDArray[np.bool_]
    verdicts: NDArray[Any]
    summaries: tuple[dict[str, Any], ...]

    def __repr__(self) -> str:
        runs, times, robots = self.in_safe_mode.shape
        return f"<Result of {self.scenario.name or 'a scenario'}: {runs} runs, {times} times, {robots} robots>"

    def columns(self, table: Table = "robots") -> dict[str, Any]:
        """Return a table by column; `phalanx.lab.tables` converts it to a `pandas.DataFrame`.

        Args:
            table: robots: seed, time_s, robot, x_m, y_m, vx_mps, vy_mps, in_safe_mode, compromised; verdicts: as
                `verdicts`, with the refusal by name; runs: the single values of each summary.
        Raises: UsageError: no such table.
        """
        if table == "verdicts":
            names = {refusal.value: refusal.name for refusal in Refusal}
            columns: dict[str, Any] = {name: self.verdicts[name].copy() for name in VERDICT.names or ()}
            return columns | {"refusal": [names[number] for number in self.verdicts["refusal"].tolist()]}
        if table == "runs":
            one = {key for key in self.summaries[0] if key not in SERIES}
            return {key: [_shown(run[key]) for run in self.summaries] for key in self.summaries[0] if key in one} | {
                "compromised": [_shown([liar["robot"] for liar in run["compromised"]]) for run in self.summaries]
            }
        if table != "robots":
            raise UsageError(f"no table {table!r}", "use robots, verdicts or runs")
        runs, times, robots = self.in_safe_mode.shape
        shape = self.in_safe_mode.shape
        return {
            "seed": np.repeat(self.seeds, times * robots),
            "time_s": np.tile(np.repeat(self.times_s, robots), runs),
            "robot": np.tile(self.ids, runs * times),
            "x_m": self.positions_m[..., 0].ravel(),
            "y_m": self.positions_m[..., 1].ravel(),
            "vx_mps": self.velocities_mps[..., 0].ravel(),
            "vy_mps": self.velocities_mps[..., 1].ravel(),
            "in_safe_mode": self.in_safe_mode.flatten(),
            "compromised": np.broadcast_to(self.compromised[:, None, :], shape).flatten(),
        }


def _shown(value: Any) -> Any:
    """Return a list of robots as text, for tables that cannot hold lists."""
    return " ".join(map(str, value)) if isinstance(value, list) else value
