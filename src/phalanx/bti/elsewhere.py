"""Trusted nodes that are not in this process: kernels call them as they call those that are.

Such a node's row is a number and no memory, by which whoever answers for it is found (net/serial_node.py). A kernel
takes numbers alone: what goes wrong on the way is a refusal to it, and is raised by `raise_failed` once it is back.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from phalanx.wire import Record, lines
from phalanx.wire.fields import get_u32, put_u32, row
from phalanx.wire.table import ENTRY_HEADER_BYTES, MAC_BYTES

from . import trusted

# Which call each function is; its arguments are the call's fields, in their order.
FUNCTIONS = {
    trusted.snode_poll: lines.POLL,
    trusted.anode_recv: lines.RECV,
    trusted.anode_send: lines.SEND,
    trusted.anode_actuate: lines.ACTUATE,
    trusted.snode_make_auth: lines.MAKE_AUTH,
    trusted.snode_check_auth: lines.CHECK_AUTH,
    trusted.anode_token_request: lines.TOKEN_REQUEST,
    trusted.anode_issue_token: lines.ISSUE_TOKEN,
    trusted.anode_check_token: lines.CHECK_TOKEN,
    trusted.anode_install_token: lines.INSTALL_TOKEN,
    trusted.anode_check: lines.CHECK,
}
# Bytes of what a call makes; those that are not here make an entry around what they are given, or nothing.
MADE = {lines.MAKE_AUTH: trusted.AUTH_BYTES, lines.TOKEN_REQUEST: trusted.TREQ_BYTES, lines.ISSUE_TOKEN: MAC_BYTES}
FORWARDED = {lines.POLL, lines.RECV, lines.SEND, lines.ACTUATE}
FAILED: int = trusted.E_ARG


class Elsewhere(Protocol):
    """A robot's two trusted nodes, wherever they are."""

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """Ask the remote node to run a call; return its result code and its output bytes.

        Args:
            call: of wire.lines.
            now_ms: the time, for nodes that are told it; None if the function has nothing to do with time.
            arguments: the call's fields but its number.
        Returns: a code >= 0 with exactly what `made_by` says, or one of trusted's errors with nothing.
        Raises: Unavailable: no such answer, or none in time.
        """
        ...


def made_by(call: Record, **arguments: Any) -> int:
    """Bytes of what a call makes if it is not refused."""
    if call in FORWARDED:
        (data,) = arguments.values()
        return ENTRY_HEADER_BYTES + len(data)
    return MADE.get(call, 0)


_placed: dict[int, Elsewhere] = {}
_failed: list[BaseException] = []


def place(nodes: Sequence[Elsewhere]) -> NDArray[np.uint8]:
    """The rows by which kernels know these nodes, (n, ELSEWHERE_BYTES), until `forget`."""
    rows = np.zeros((len(nodes), trusted.ELSEWHERE_BYTES), np.uint8)
    for each, its in zip(nodes, rows, strict=True):
        number = max(_placed, default=0) + 1
        _placed[number] = each
        put_u32(its, 0, number)
    return rows


def forget(rows: NDArray[np.uint8]) -> None:
    """Nobody answers for these nodes any more."""
    for each in rows:
        _placed.pop(get_u32(each, 0), None)


def raise_failed() -> None:
    """Nothing has gone wrong on the way to a node since the last call.

    Raises: what did, the first time.
    """
    failed = _failed[:1]
    _failed.clear()
    for error in failed:
        raise error


def _asks(kernel: Any, call: Record) -> Callable[..., int]:
    """Return the callback that `kernel` calls for a node on another machine."""
    view = trusted.FIRMWARE[trusted.HARDENED][0].buffer
    declared = inspect.signature(getattr(kernel, "py_func", kernel)).parameters
    told = [name for name in declared if name not in ("profile", "node")]
    fields = call.fields[1:]

    def ask(node: Any, *values: Any) -> int:
        given = dict(zip(told, values, strict=True))
        now_ms = given.pop("now", None)
        if "data" in given:
            given["data"] = bytes(view(given["data"], given.pop("length")))
        # Behind the call's arguments comes where to put what is made.
        pairs = zip(fields, given.values(), strict=False)
        arguments = {f.name: x if isinstance(x, int | bytes) else bytes(view(x, f.size)) for f, x in pairs}
        try:
            number = row(bytes(view(node, trusted.ELSEWHERE_BYTES)))
            code, result = _placed[get_u32(number, 0)].ask(call, now_ms, **arguments)
        except BaseException as error:  # noqa: BLE001 - C that called us would lose it, as it would Ctrl-C
            _failed.append(error)
            return FAILED
        if result:
            view(list(given.values())[-1], len(result))[:] = result
        return code

    return ask


for _kernel, _call in FUNCTIONS.items():
    trusted.ELSEWHERE[_kernel.__name__] = _asks(_kernel, _call)
