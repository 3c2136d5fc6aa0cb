"""The trusted nodes' C functions as kernels: the only interface to them, from compiled and from plain Python code.

`profile` is 0 (hardened) or 1 (paper): two builds of firmware/. A node is a row of bytes that only the C reads, or, in
`hardened`, the number of a remote node (elsewhere.py). Rows and buffers are contiguous uint8. Functions return the
C function's result: >= 0, or one of the E_ codes. The length of every row is checked before its address is passed to
C; a row that is too short gives E_ARG.
docs/adr/0010 describes how kernels find the C functions.
Source: RoboRebound Alg. 2-4; docs/spec/rebound-nodes.md.
"""

# Functions decorated with `_in_c` are declarations without a body.
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
ELSEWHERE_BYTES = U32_BYTES  # length of a remote node's row
# Callbacks for remote nodes by function name: same arguments, with rows as cffi pointers (elsewhere.py).
ELSEWHERE: dict[str, Callable[..., int]] = {}
AUTH_BYTES = table.AUTHENTICATOR.size
TREQ_BYTES = table.TOKEN_REQUEST.size

E_ARG: int = hardened_lib.PHX_E_ARG
E_AIRTIME: int = hardened_lib.PHX_E_AIRTIME
E_BAD_MAC: int = hardened_lib.PHX_E_BAD_MAC
REASONS = {
    getattr(hardened_lib, e): e.removeprefix("PHX_E_").lower() for e in dir(hardened_lib) if e.startswith("PHX_E_")
}
# Bytes of a node in each profile, by the prefix of its functions' names. They are the same on every machine: all fields
# have fixed widths.
NODE_BYTES = {
    profile: {"snode": lib.phx_snode_size(), "anode": lib.phx_anode_size()} for profile, (_, lib) in FIRMWARE.items()
}
# Condition for each parameter, by its name. The C itself refuses more than PACKET_MAX bytes before writing an entry.
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


# The parameter that each function writes to, beside its node.
WRITTEN = {
    **dict.fromkeys(("snode_poll", "anode_recv", "anode_send", "anode_actuate"), "entry"),
    **dict.fromkeys(("snode_make_auth", "anode_make_auth"), "auth"),
    "anode_token_request": "treq",
    **dict.fromkeys(("anode_issue_token", "lightmac"), "mac"),
    "sha1": "digest",
    "chain_extend": "top",
}


def counted() -> tuple[int, int]:
    """Return the number of blocks that this process has hashed, and of those encrypted, while `host_use` was 1."""
    totals = [ffi.new("uint64_t[2]") for ffi, _ in FIRMWARE.values()]
    for (_, lib), counts in zip(FIRMWARE.values(), totals, strict=True):
        lib.phx_host_count(counts)
    return sum(int(counts[0]) for counts in totals), sum(int(counts[1]) for counts in totals)


class _CFunction:
    """C function that kernels call with rows and numbers; compiled kernels call it by its address."""

    def __init__(self, ffi: Any, symbol: str, function: Any, writes: tuple[int, ...]) -> None:
        self.__c_symbol__, self.__c_writes__ = symbol, writes
        self._ffi, self._function = ffi, function
        link(symbol, int(ffi.cast("uintptr_t", function)))

    def __call__(self, *arguments: Any) -> int:
        """Call the C function, for kernels that run uncompiled."""
        return int(self._function(*(self._in_c(n, each) for n, each in enumerate(arguments))))

    def _in_c(self, n: int, value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return int(value)
        if n in self.__c_writes__ and not value.flags.writeable:
            raise ValueError("read-only array passed to a C function that writes to it")
        return self._ffi.cast("void *", self._ffi.from_buffer(value))


def _c_function(profile: int, name: str, writes: tuple[int, ...]) -> _CFunction:
    ffi, lib = FIRMWARE[profile]
    return _CFunction(ffi, f"phx_{('hardened', 'paper')[profile]}_{name}", ffi.addressof(lib, f"phx_{name}"), writes)


def _elsewhere(name: str, writes: tuple[int, ...]) -> _CFunction:
    """Return the function for remote nodes: a C callback into Python."""

    def ask(*arguments: Any) -> int:
        return ELSEWHERE[name](*arguments) if name in ELSEWHERE else E_ARG

    kind = hardened_ffi.typeof(hardened_ffi.addressof(hardened_lib, f"phx_{name}"))
    return _CFunction(hardened_ffi, f"phx_elsewhere_{name}", hardened_ffi.callback(kind, ask, error=E_ARG), writes)


def _in_c(declared: _F) -> _F:
    """Return a kernel that checks CHECKS, and calls the C function of the same name and parameters.

    The parameter `profile` selects the build; functions without it are the same in both. Functions that exist only in
    `paper` return E_ARG in `hardened`.
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
        raise Unavailable(f"the compiled trusted nodes have no phx_{name}", "run make setup to compile them")
    passed = ", ".join(given)
    rows = {each.name for each in parameters.values() if each.annotation == "Row"}
    assert rows <= CHECKS.keys() | {"node"}, "every row needs an entry in CHECKS"
    checks = " and ".join(CHECKS[each] for each in parameters if each in CHECKS)
    body = [f"if not ({checks}):", "    return E_ARG"] if checks else []
    if "node" in parameters and f"in_{HARDENED}" in scope:
        scope["elsewhere"] = _elsewhere(name, writes)
        body += [f"if node.size == {ELSEWHERE_BYTES}:", f"    return elsewhere({passed})"]
    calls = {profile: _call(profile, name, passed, "node" in parameters, scope) for profile in FIRMWARE}
    if "profile" in parameters:
        body += [f"if profile == {PAPER}:", f"    return {calls[PAPER]}"]
    body.append(f"return {calls[HARDENED]}")
    return written(declared, body, {"E_ARG": E_ARG, **scope})


def _call(profile: int, name: str, passed: str, has_node: bool, scope: dict[str, Any]) -> str:
    """Return the expression that calls the C function of a profile: E_ARG without one, or if the node is too short."""
    if f"in_{profile}" not in scope:
        return "E_ARG"
    is_long = f" if node.size >= {NODE_BYTES[profile][name.partition('_')[0]]} else E_ARG" if has_node else ""
    return f"in_{profile}({passed}){is_long}"


@_in_c
def snode_poll(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """Chain a sensor reading; write the entry for the c-node and its log to `entry`.

    Returns: the entry's length. Source: RoboRebound Alg. 3 (PollSensors).
    """


@_in_c
def anode_recv(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """Admit a packet from the radio to the c-node as `entry[7:]`; chain it unless it is an AUDIT packet.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (RecvWireless).
    """


@_in_c
def anode_send(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """Admit a packet to the radio as `entry[7:]`; `hardened` writes this robot's id as source of an AUDIT packet.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (SendWireless).
    """


@_in_c
def anode_actuate(profile: int, node: Row, now: int, data: Row, length: int, entry: Row) -> int:
    """Admit a command to the actuators as `entry[7:]`.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (ActuatorCmd).
    """


@_in_c
def snode_make_auth(profile: int, node: Row, nonce: Row, auth: Row) -> int:
    """Flush the s-chain and write the record `authenticator` of it to `auth`. `paper` ignores the nonce.

    Source: RoboRebound Alg. 2 (MakeAuthenticator).
    """


@_in_c
def snode_check_auth(profile: int, node: Row, top: Row, robot_id: int, nonce: Row, mac: Row) -> int:
    """Return 0 if robot_id's s-node made this authenticator for this nonce. Source: RoboRebound Alg. 3."""


@_in_c
def anode_make_auth(profile: int, node: Row, auth: Row) -> int:
    """Flush the a-chain and write its `authenticator` to `auth`; `paper` only. Source: RoboRebound Alg. 2."""


@_in_c
def snode_check_auth_a(profile: int, node: Row, top: Row, robot_id: int, mac: Row) -> int:
    """Return 0 if robot_id's a-node made this authenticator; `paper` only. Source: RoboRebound Alg. 3."""


@_in_c
def anode_token_request(profile: int, node: Row, now: int, auditor: int, treq: Row) -> int:
    """Flush the a-chain and write the record `token_request` to `treq`; in `paper` its top is zeros.

    Source: RoboRebound Alg. 4 (MakeTokenRequest).
    """


@_in_c
def anode_issue_token(
    profile: int, node: Row, auditee: int, t: int, top: Row, treq_mac: Row, hckpt: Row, mac: Row
) -> int:
    """Write the token for `auditee`'s request to `mac`; call it only after an audit of the log up to `top` passed.

    Source: RoboRebound Alg. 4 (IssueToken).
    """


@_in_c
def anode_check_token(profile: int, node: Row, auditor: int, auditee: int, t: int, hckpt: Row, mac: Row) -> int:
    """Return 0 if `auditor` issued this token to `auditee`.

    Source: RoboRebound Alg. 4 (IsTokenValid, with the auditee named).
    """


@_in_c
def anode_install_token(profile: int, node: Row, now: int, auditor: int, t: int, hckpt: Row, mac: Row) -> int:
    """Install a token, which counts until it expires; return 0. Source: RoboRebound Alg. 4 (InstallToken)."""


@_in_c
def anode_check(profile: int, node: Row, now: int) -> int:
    """Check the tokens; return 1 if the robot is in Safe Mode, else 0. Source: RoboRebound Alg. 4 (CheckTokens)."""


@_in_c
def host_use(profile: int, fast: int) -> int:
    """Compute hashes and MACs of the whole process with this processor's instructions, or, if `fast` is 0, in plain C.

    The results are the same bytes. The firmware's plain C is the default. Returns: 0 if plain C is in use.
    """


@_in_c
def sha1(data: Row, length: int, digest: Row) -> int:
    """Write the SHA-1 hash of `data[:length]` to `digest`. Source: FIPS 180."""


@_in_c
def chain_extend(top: Row, data: Row, length: int) -> int:
    """Replace `top` by H(top ‖ data[:length]): one flush of a chain. Source: RoboRebound Alg. 2 (FlushBuffer)."""


@_in_c
def lightmac(key: Row, data: Row, length: int, mac: Row) -> int:
    """Write the MAC of `data[:length]`, at most 1791 bytes, under K1 ‖ K2 to `mac`. Source: Luykx et al., FSE 2016."""


@_in_c
def order_check(signer: Row, data: Row, length: int) -> int:
    """Return 0 if `data[:length]` ends in a valid signature (64 bytes) of all bytes before, by the key `signer` (32,).

    The result depends on these bytes only, so auditors get the same result. Source: RFC 8032 (Ed25519).
    """
