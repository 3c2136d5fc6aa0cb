"""Remote trusted nodes: kernels call them as they call those in this process.

The row of a remote node contains a number, by which its driver is found (net/serial_node.py). Kernels receive only
result codes: to them, a failed call is a refusal. The exception is stored, and `raise_failed` raises it afterwards.
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

# The remote call of each function; its arguments are the call's fields, in their order.
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
# Output bytes of calls; those in FORWARDED return an entry around their data, all others nothing.
MADE = {lines.MAKE_AUTH: trusted.AUTH_BYTES, lines.TOKEN_REQUEST: trusted.TREQ_BYTES, lines.ISSUE_TOKEN: MAC_BYTES}
FORWARDED = {lines.POLL, lines.RECV, lines.SEND, lines.ACTUATE}
FAILED: int = trusted.E_ARG


class RemoteNodes(Protocol):
    """A robot's two trusted nodes on another machine."""

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """Run a call on the remote node; return its result code and its output bytes.

        Args:
            call: of wire.lines.
            now_ms: the time, for nodes without a clock; None if the function does not depend on time.
            arguments: the call's fields except its number.
        Returns: a code >= 0 with exactly `output_size` bytes, or one of trusted's errors with none.
        Raises: Unavailable: no answer in time, or an invalid one.
        """
        ...


def output_size(call: Record, **arguments: Any) -> int:
    """Return the number of output bytes of a call that is not refused."""
    if call in FORWARDED:
        (data,) = arguments.values()
        return ENTRY_HEADER_BYTES + len(data)
    return MADE.get(call, 0)


_placed: dict[int, RemoteNodes] = {}
_failed: list[BaseException] = []


def register_remote(nodes: Sequence[RemoteNodes]) -> NDArray[np.uint8]:
    """Register remote nodes until `unregister_remote`, and return their rows for kernels, (n, ELSEWHERE_BYTES)."""
    rows = np.zeros((len(nodes), trusted.ELSEWHERE_BYTES), np.uint8)
    for each, its in zip(nodes, rows, strict=True):
        number = max(_placed, default=0) + 1
        _placed[number] = each
        put_u32(its, 0, number)
    return rows


def unregister_remote(rows: NDArray[np.uint8]) -> None:
    """Unregister remote nodes; later calls to them fail."""
    for each in rows:
        _placed.pop(get_u32(each, 0), None)


def raise_failed() -> None:
    """Raise the first exception of a call to a remote node since the last time this function was called, if any."""
    failed = _failed[:1]
    _failed.clear()
    for error in failed:
        raise error


def _asks(kernel: Any, call: Record) -> Callable[..., int]:
    """Return the callback that `kernel` calls for a remote node."""
    view = trusted.FIRMWARE[trusted.HARDENED][0].buffer
    declared = inspect.signature(getattr(kernel, "py_func", kernel)).parameters
    names = [name for name in declared if name not in ("profile", "node")]
    fields = call.fields[1:]

    def ask(node: Any, *values: Any) -> int:
        given = dict(zip(names, values, strict=True))
        now_ms = given.pop("now", None)
        if "data" in given:
            given["data"] = bytes(view(given["data"], given.pop("length")))
        # After the call's arguments comes the buffer for its output.
        pairs = zip(fields, given.values(), strict=False)
        arguments = {f.name: x if isinstance(x, int | bytes) else bytes(view(x, f.size)) for f, x in pairs}
        try:
            number = row(bytes(view(node, trusted.ELSEWHERE_BYTES)))
            code, result = _placed[get_u32(number, 0)].ask(call, now_ms, **arguments)
        except BaseException as error:  # noqa: BLE001 - C calls this function and would drop it, even KeyboardInterrupt
            _failed.append(error)
            return FAILED
        if result:
            view(list(given.values())[-1], len(result))[:] = result
        return code

    return ask


for _kernel, _call in FUNCTIONS.items():
    trusted.ELSEWHERE[_kernel.__name__] = _asks(_kernel, _call)
