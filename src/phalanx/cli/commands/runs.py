"""How a command finds what it does."""

from __future__ import annotations

import functools
import gc
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


def runs(module: str, function: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """The command calls `function` of `phalanx.cli.MODULE` with its options by name, and imports that only then.

    What is decorated says in its docstring what the command does, for its help.
    """

    def declared(words: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(words)
        def run(**said: Any) -> Any:
            body = getattr(_imported(f"phalanx.cli.{module}"), function)
            _answer_ctrl_c()
            return body(**said)

        run.runs = module, function  # type: ignore[attr-defined]
        return run

    return declared


def _imported(name: str) -> ModuleType:
    """The module; what it is made of stays, and is not looked through for garbage: that took a fifth of a start."""
    if name not in sys.modules:
        gc.disable()
        import_module(name)
        gc.freeze()
        gc.enable()
    return sys.modules[name]


def _answer_ctrl_c() -> None:
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # as __main__.py leaves it
        signal.signal(signal.SIGINT, signal.default_int_handler)
