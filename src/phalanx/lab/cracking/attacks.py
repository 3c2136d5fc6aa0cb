"""The attacks that guess a captured mission, for the registry: what carries them out is loaded when it is needed."""

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
           does="tries every place in an area of 40 m x 40 m against a captured mission and its start key",
           stopped_by="in `hardened` each try is an scrypt, which limits how fast; `paper` is a commitment and "
                      "hides no place"),
    _guess("guess-plan", "GuessPlan", BITES, READ, 1,
           does="tries what the building's floor plan shows against a captured mission and its start key",
           stopped_by="nothing: a floor plan shows all places; what it does not show is a token or a message. A "
                      "start key that was not captured keeps payloads shut, and hides no place"),
    _guess("guess-gate", "GuessGate", by_defence("bites", "bites", "harmless"), READ, 1,
           does="tries to read a captured mission without its start key, with gates that it draws",
           stopped_by="in `hardened` 2^256 gates stand before the first payload, but who matches the file's graph "
                      "with a floor plan needs none for the places; `paper` has no start key"),
    _guess("guess-token", "GuessToken", by_defence("bites", "harmless", "harmless"), READ, 1,
           does="tries random tokens against the node of a captured mission whose place it knows, with all "
                "that leads there",
           stopped_by="128 random bits in a code on the wall are on no floor plan, in either profile"),
)
# fmt: on
ATTACKS = {attack.name: attack for attack in _GUESSES}
