"""The trusted nodes' C as kernels: the only way to them, compiled and not, for one robot or in loops over a fleet.

`profile` is 0 (hardened) or 1 (paper): two builds of firmware/. A node is a row of bytes that only the C reads, or, in
`hardened`, the number of one that is not here (elsewhere.py); rows and buffers are contiguous uint8. Functions return
what the C returns, >= 0 or one of the E_ codes. The length of every row is checked before the C gets its address: a
row that is too short is E_ARG.
How kernels find the C is in docs/adr/0010.
Source: RoboRebound Alg. 2-4; docs/spec/rebound-nodes.md.
"""

# Functions under `_in_c` are declarations: their docstring is all that they have.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from phalanx._firmware_hardened import ffi as hardened_ffi
from phalanx._firmware_hardened import lib as hardened_lib
from phalanx._firmware_paper import ffi as paper_ffi
from phalanx._firmware_paper import lib as paper_lib
from phalanx.errors import Unavailable
from phalanx.kernel import link, written
from phalanx.wire import driven, table
from phalanx.wire.fields import U32_BYTES, Row

_F = TypeVar("_F", bound=Callable[..., Any])

HARDENED, PAPER = 0, 1
FIRMWARE: dict[int, tuple[Any, Any]] = {HARDENED: (hardened_ffi, hardened_lib), PAPER: (paper_ffi, paper_lib)}
ELSEWHERE_BYTES = U32_BYTES  # of the row of a node that is not here
# What each function does with such a node, by its name: the same arguments, pointers as cffi has them (elsewhere.py).
ELSEWHERE: dict[str, Callable[..., int]] = {}
AUTH_BYTES = table.AUTHENTICATOR.size
TREQ_BYTES = table.TOKEN_REQUEST.size

E_ARG: int = hardened_lib.PHX_E_ARG
E_AIRTIME: int = hardened_lib.PHX_E_AIRTIME
E_BAD_MAC: int = hardened_lib.PHX_E_BAD_MAC
REASONS = {
    getattr(hardened_lib, e): e.removeprefix("PHX_E_").lower() for e in dir(hardened_lib) if e.startswith("PHX_E_")
}
# Bytes of a node in each profile, by the first word of a function's name; on every machine the same, as a node's fields
# have fixed widths.
NODE_BYTES = {
    profile: {"snode": lib.phx_snode_size(), "anode": lib.phx_anode_size()} for profile, (_, lib) in FIRMWARE.items()
}
# What must hold of a parameter of such a name. More than PACKET_MAX the C refuses itself, before it touches an entry.
CHECKS = {
    "data": "0 <= length <= data.size",
    "entry": f"min(length, {table.PACKET_MAX}) + {table.ENTRY_HEADER_BYTES} <= entry.size",
    **{name: f"{name}.size >= {table.HASH_BYTES}" for name in ("top", "hckpt", "digest")},
    **{name: f"{name}.size >= {table.MAC_BYTES}" for name in ("mac", "treq_mac")},
    "key": f"key.size >= {table.KEY_BYTES}",
    "nonce": f"nonce.size >= {table.NONCE_BYTES}",
    "auth": f"auth.size >= {AUTH_BYTES}",
    "treq": f"treq.size >= {TREQ_BYTES}",
    "signer": f"signer.size >= {driven.SIGNER_KEY_BYTES}",
}


# The row that a function writes to, beside its node.
WRITTEN = {
    **dict.fromkeys(("snode_poll", "anode_recv", "anode_send", "anode_actuate"), "entry"),
    **dict.fromkeys(("snode_make_auth", "anode_make_auth"), "auth"),
    "anode_token_request": "treq",
    **dict.fromkeys(("anode_issue_token", "lightmac"), "mac"),
    "sha1": "digest",
    "chain_extend": "top",
}


def counted() -> tuple[int, int]:
    """How many blocks this process has hashed and how many encrypted since it began, without what `host_use` 0 did."""
    told = [ffi.new("uint64_t[2]") for ffi, _ in FIRMWARE.values()]
    for (_, lib), counts in zip(FIRMWARE.values(), told, strict=True):
        lib.phx_host_count(counts)
    return sum(int(counts[0]) for counts in told), sum(int(counts[1]) for counts in told)


class _CFunction:
    """A C function that kernels call, with rows and numbers; compiled, by its address, which is linked here."""

    def __init__(self, ffi: Any, symbol: str, function: Any, writes: tuple[int, ...]) -> None:
        self.__c_symbol__, self.__c_writes__ = symbol, writes
        self._ffi, self._function = ffi, function
        link(symbol, int(ffi.cast("uintptr_t", function)))

    def __call__(self, *arguments: Any) -> int:
        """Return what the C returns, for kernels that run uncompiled."""
        return int(self._function(*(self._in_c(n, each) for n, each in enumerate(arguments))))

    def _in_c(self, n: int, value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return int(value)
        if n in self.__c_writes__ and not value.flags.writeable:
            raise ValueError("an array is read-only, and the C writes to it")
        return self._ffi.cast("void *", self._ffi.from_buffer(value))


def _c_function(profile: int, name: str, writes: tuple[int, ...]) -> _CFunction:
    ffi, lib = FIRMWARE[profile]
    return _CFunction(ffi, f"phx_{('hardened', 'paper')[profile]}_{name}", ffi.addressof(lib, f"phx_{name}"), writes)


def _elsewhere(name: str, writes: tuple[int, ...]) -> _CFunction:
    """Return the same function of a node that is not here: C that calls Python."""

    def ask(*arguments: Any) -> int:
        return ELSEWHERE[name](*arguments) if name in ELSEWHERE else E_ARG

    kind = hardened_ffi.typeof(hardened_ffi.addressof(hardened_lib, f"phx_{name}"))
    return _CFunction(hardened_ffi, f"phx_elsewhere_{name}", hardened_ffi.callback(kind, ask, error=E_ARG), writes)


def _in_c(declared: _F) -> _F:
    """The kernel that calls the C function of the same name and parameters, in the profile's build, if all CHECKS hold.

    Without a profile it is the same in both. What only `paper` has is E_ARG in `hardened`.
    """
    name = declared.__name__
    parameters = inspect.signature(declared).parameters
    given = [each for each in parameters if each != "profile"]
    writes = tuple(n for n, each in enumerate(given) if each in ("node", WRITTEN.get(name)))
    scope: dict[str, Any] = {
        f"in_{profile}": _c_function(profile, name, writes)
        for profile, (_, lib) in FIRMWARE.items()
        if hasattr(lib, f"phx_{name}")
    }
    if not scope:
        raise Unavailable(f"the compiled trusted nodes have no phx_{name}", "make setup, or pip install, compiles them")
    told = ", ".join(given)
    rows = {each.name for each in parameters.values() if each.annotation == "Row"}
    assert rows <= CHECKS.keys() | {"node"}, "no row goes to C unchecked"
    checks = " and ".join(CHECKS[each] for each in parameters if each in CHECKS)
    body = [f"if not ({checks}):", "    return E_ARG"] if checks else []
    if "node" in parameters and f"in_{HARDENED}" in scope:
        scope["elsewhere"] = _elsewhere(name, writes)
        body += [f"if node.size == {ELSEWHERE_BYTES}:", f"    return elsewhere({told})"]
    calls = {profile: _call(profile, name, told, "node" in parameters, scope) for profile in FIRMWARE}
    if "profile" in parameters:
        body += [f"if profile == {PAPER}:", f"    return {calls[PAPER]}"]
    body.append(f"return {calls[HARDENED]}")
    return written(declared, body, {"E_ARG": E_ARG, **scope})


def _call(profile: int, name: str, told: str, has_node: bool, scope: dict[str, Any]) -> str:
    """Return the expression that calls the C of a profile, if it has such a function and the node is long enough."""
    if f"in_{profile}" not in scope:
        return "E_ARG"
    is_long = f" if node.size >= {NODE_BYTES[profile][name.partition('_')[0]]} else E_ARG" if has_node else ""
    return f"in_{profile}({told}){is_long}"


@_in_c
def snode_poll(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """The reading is chained; `entry` is what the c-node gets and logs.

    Returns: the entry's length. Source: RoboRebound Alg. 3 (PollSensors).
    """


@_in_c
def anode_recv(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """A packet from the radio may go to the c-node: `entry[7:]`, chained unless it is an AUDIT packet.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (RecvWireless).
    """


@_in_c
def anode_send(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """A packet may go to the radio: `entry[7:]`, which in `hardened` names this robot as source of an AUDIT packet.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (SendWireless).
    """


@_in_c
def anode_actuate(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """A command may go to the actuators: `entry[7:]`.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (ActuatorCmd).
    """


@_in_c
def snode_make_auth(profile: int, node: Row, nonce: Row, auth: Row) -> int:
    """`auth` is the record `authenticator`; the s-chain is flushed. `paper` ignores the nonce.

    Source: RoboRebound Alg. 2 (MakeAuthenticator).
    """


@_in_c
def snode_check_auth(profile: int, node: Row, top: Row, robot_id: int, nonce: Row, mac: Row) -> int:
    """0 if robot_id's s-node made this authenticator, for this nonce. Source: RoboRebound Alg. 3."""


@_in_c
def anode_make_auth(profile: int, node: Row, auth: Row) -> int:
    """`paper` only: `auth` is the record `authenticator` of the a-chain, flushed. Source: RoboRebound Alg. 2."""


@_in_c
def snode_check_auth_a(profile: int, node: Row, top: Row, robot_id: int, mac: Row) -> int:
    """`paper` only: 0 if robot_id's a-node made this authenticator. Source: RoboRebound Alg. 3."""


@_in_c
def anode_token_request(profile: int, node: Row, now: int, auditor: int, treq: Row) -> int:
    """`treq` is the record `token_request`; the a-chain is flushed. In `paper` the top is left out: zeros.

    Source: RoboRebound Alg. 4 (MakeTokenRequest).
    """


@_in_c
def anode_issue_token(
    profile: int, node: Row, auditee: int, t: int, top: Row, treq_mac: Row, hckpt: Row, mac: Row
) -> int:
    """`mac` is the token for `auditee`'s request: the caller has replayed its log up to `top` and found no fault.

    Source: RoboRebound Alg. 4 (IssueToken).
    """


@_in_c
def anode_check_token(profile: int, node: Row, auditor: int, auditee: int, t: int, hckpt: Row, mac: Row) -> int:
    """Return 0 if `auditor` issued this token to `auditee`.

    Source: RoboRebound Alg. 4 (IsTokenValid, with the auditee named).
    """


@_in_c
def anode_install_token(profile: int, node: Row, now: int, auditor: int, t: int, hckpt: Row, mac: Row) -> int:
    """0: the token counts from now on until it is too old. Source: RoboRebound Alg. 4 (InstallToken)."""


@_in_c
def anode_check(profile: int, node: Row, now: int) -> int:
    """0, or 1: in Safe Mode, now or already. Source: RoboRebound Alg. 4 (CheckTokens)."""


@_in_c
def host_use(profile: int, fast: int) -> int:
    """From now on hashes and MACs are computed as fast as this processor can, or, with `fast` 0, by the firmware's C.

    The bytes are the same; at first it is the firmware's. Of the whole process. Returns: 0 for the firmware's.
    """


@_in_c
def sha1(data: Row, length: int, digest: Row) -> int:
    """`digest` is the hash of `data[:length]`. Source: FIPS 180."""


@_in_c
def chain_extend(top: Row, data: Row, length: int) -> int:
    """`top` becomes H(top ‖ data[:length]): one flush of a chain. Source: RoboRebound Alg. 2 (FlushBuffer)."""


@_in_c
def lightmac(key: Row, data: Row, length: int, mac: Row) -> int:
    """`mac` is that of `data[:length]`, at most 1791 bytes, under K1 ‖ K2. Source: Luykx et al., FSE 2016."""


@_in_c
def order_check(signer: Row, data: Row, length: int) -> int:
    """0 if `data[:length]` ends in a signature of all before it, 64 bytes, under the signer's key, 32 bytes.

    A pure function of these bytes, so that auditors find what the robot found. Source: RFC 8032 (Ed25519).
    """
