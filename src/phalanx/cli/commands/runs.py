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

import click

from phalanx.cli.terminal import Progress


def runs(module: str, function: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """The command calls `function` of `phalanx.cli.MODULE` with its options by name, and imports that only then.

    What is decorated says in its docstring what the command does, for its help. While the function runs, people are
    told of kernels that have to be compiled.
    """

    def declared(words: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(words)
        def run(**said: Any) -> Any:
            body = getattr(_imported(f"phalanx.cli.{module}"), function)
            tell_of_compiling()
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


def tell_of_compiling() -> None:
    """From now on to the end of the command, people are told of kernels that have to be compiled."""
    context = click.get_current_context()
    # `up` gets robots ready before it begins, and tells of that itself.
    if "numba" in sys.modules and context.info_name != "up" and not context.meta.get(__name__):
        context.meta[__name__] = True  # once is enough
        from phalanx.sim.compiling import telling_of_compiling  # noqa: PLC0415 - others need not wait for numba

        context.with_resource(telling_of_compiling(Progress(0.0, 15.0).tell))
