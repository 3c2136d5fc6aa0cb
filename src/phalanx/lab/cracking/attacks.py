"""Registry entries of the attacks that guess a captured mission; their code is imported on demand."""

from __future__ import annotations

from functools import partial
from typing import Any

from phalanx.attacks.library import BITES, LIMITED
from phalanx.robot.adversary.attack import Attack, by_defence
from phalanx.robot.adversary.harm import READ


def _of(name: str, made_of: str, *rest: Any, **more: Any) -> Attack:
    return Attack(name, f"{__package__}.guesses.{made_of}", *rest, **more)


_guess = partial(_of, scene="file", against="secrecy")
# fmt: off
_GUESSES = (
    _guess("guess-graph", "GuessGraph", LIMITED, READ, 1,
           does="tries every position in an area of 40 m x 40 m against a captured mission and its start key",
           stopped_by="in `hardened` each try needs an scrypt, which limits the rate; `paper` is a commitment and "
                      "hides no position"),
    _guess("guess-plan", "GuessPlan", BITES, READ, 1,
           does="tries the landmarks of the building's floor plan against a captured mission and its start key",
           stopped_by="nothing: a floor plan shows all landmarks, but no token or message. A start key that was "
                      "not captured keeps payloads secret, but hides no position"),
    _guess("guess-gate", "GuessGate", by_defence("bites", "bites", "harmless"), READ, 1,
           does="tries to read a captured mission without its start key, with random gate secrets",
           stopped_by="in `hardened` the first payload has 2^256 possible gate secrets, but matching the file's "
                      "graph with a floor plan reveals the positions; `paper` has no start key"),
    _guess("guess-token", "GuessToken", by_defence("bites", "harmless", "harmless"), READ, 1,
           does="tries random tokens against the node of a captured mission whose position and predecessors it "
                "knows",
           stopped_by="the code on the wall has 128 random bits, which no floor plan shows, in either profile"),
)
# fmt: on
ATTACKS = {attack.name: attack for attack in _GUESSES}
