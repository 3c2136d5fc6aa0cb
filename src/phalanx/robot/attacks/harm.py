"""What an attack has done to the swarm, as a number: measured in the world, beside the same run where nobody lies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # the list of attacks does not wait for it
    import numpy as np
    from numpy.typing import NDArray

    from .liar import Liar


class Watched(Protocol):
    """A run, as far as harm is read from it (phalanx.sim.scenarios.run.Run is one)."""

    @property
    def now_s(self) -> float:
        """Simulated seconds so far."""

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(N, 2), world frame."""

    @property
    def in_safe_mode(self) -> NDArray[np.bool_]:
        """(N,)."""

    @property
    def compromised(self) -> dict[int, str]:
        """Names of the attacks, by robot id."""

    @property
    def airtime_s(self) -> NDArray[np.float64]:
        """(N,), for how long each robot was on the air."""


@dataclass(frozen=True, slots=True)
class Harm:
    """One way to measure damage."""

    words: str  # what is measured, for people
    unit: str
    of: Callable[
        ..., float
    ]  # the number: of a liar in a run, and the same run without it, or what else its scene leaves


def _correct(attacked: Watched) -> list[int]:
    return [i for i in range(len(attacked.positions_m)) if i + 1 not in attacked.compromised]


def _apart_m(attacked: Watched, honest: Watched) -> NDArray[np.float64]:
    apart: NDArray[np.float64] = ((attacked.positions_m - honest.positions_m) ** 2).sum(axis=1) ** 0.5
    return apart


def _astray(_liar: Liar, attacked: Watched, honest: Watched) -> float:
    # Others only: where a liar has taken itself is no harm to anybody.
    correct = _correct(attacked)
    return float(_apart_m(attacked, honest)[correct].mean()) if correct else 0.0


def _starved(_liar: Liar, attacked: Watched, _honest: Watched) -> float:
    return float(attacked.in_safe_mode[_correct(attacked)].sum())


def _airtime(liar: Liar, attacked: Watched, honest: Watched) -> float:
    # A liar in Safe Mode is silent: neither the time after it counts, nor what an honest robot would have said then.
    needed_s = float(honest.airtime_s[liar.i]) * liar.alive_s / attacked.now_s
    return 100 * (float(attacked.airtime_s[liar.i]) - needed_s) / liar.lied_s if liar.lied_s else 0.0


ASTRAY = Harm("how far correct robots are on the mean from where they would be", "m", _astray)
STARVED = Harm("correct robots in Safe Mode", "robots", _starved)
AIRTIME = Harm(
    "share of the time it lies, until Safe Mode, that it is on the air beyond an honest robot's", "%", _airtime
)
