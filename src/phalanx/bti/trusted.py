"""The trusted nodes' C as kernels: the only way to them, compiled and not, for one robot or in loops over a fleet.

`profile` is 0 (bound) or 1 (paper): two builds of firmware/. A node is a row of bytes that only the C reads; rows and
buffers are contiguous uint8. Functions return what the C returns, >= 0 or one of the E_ codes, and look at sizes before
the C sees an address: too small a buffer is E_ARG. How numba finds the C is in docs/adr/0010.
Source: RoboRebound Alg. 2-4; docs/spec/rebound-nodes.md.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
from numba import types
from numba.core.datamodel.models import OpaqueModel
from numba.core.datamodel.registry import register_default

from phalanx._firmware_bound import ffi as bound_ffi
from phalanx._firmware_bound import lib as bound_lib
from phalanx._firmware_paper import ffi as paper_ffi
from phalanx._firmware_paper import lib as paper_lib
from phalanx.kernel import kernel
from phalanx.wire.fields import Row
from phalanx.wire.table import (
    AUTHENTICATOR,
    ENTRY_HEADER_BYTES,
    FRAME_MAX,
    HASH_BYTES,
    KEY_BYTES,
    MAC_BYTES,
    NONCE_BYTES,
    TOKEN_REQUEST,
)

BOUND, PAPER = 0, 1
FIRMWARE: dict[int, tuple[Any, Any]] = {BOUND: (bound_ffi, bound_lib), PAPER: (paper_ffi, paper_lib)}
AUTH_BYTES = AUTHENTICATOR.size
TREQ_BYTES = TOKEN_REQUEST.size

E_NO_KEY: int = bound_lib.PHX_E_NO_KEY
E_SAFE_MODE: int = bound_lib.PHX_E_SAFE_MODE
E_TOO_LONG: int = bound_lib.PHX_E_TOO_LONG
E_BAD_MAC: int = bound_lib.PHX_E_BAD_MAC
E_SEQ: int = bound_lib.PHX_E_SEQ
E_BUCKET: int = bound_lib.PHX_E_BUCKET
E_SELF: int = bound_lib.PHX_E_SELF
E_FUTURE: int = bound_lib.PHX_E_FUTURE
E_AIRTIME: int = bound_lib.PHX_E_AIRTIME
E_CLOCK: int = bound_lib.PHX_E_CLOCK
E_ARG: int = bound_lib.PHX_E_ARG


class _CFunction(types.ExternalFunction):
    """A C function: numba links to it by its symbol, Python calls it. Addresses are integers for both.

    Only a symbol, not an address, is in what numba compiles, which is why that can be cached on disk.
    """

    def __init__(self, profile: int, name: str) -> None:
        ffi, lib = FIRMWARE[profile]
        self._cast, self._function = ffi.cast, getattr(lib, name)
        address = ffi.addressof(lib, name)
        self._is_pointer = [argument.kind == "pointer" for argument in ffi.typeof(address).args]
        arguments = [types.intp if pointer else types.uint32 for pointer in self._is_pointer]
        symbol = name.replace("phx_", ("phx_bound_", "phx_paper_")[profile], 1)
        llvmlite.binding.add_symbol(symbol, int(ffi.cast("intptr_t", address)))
        super().__init__(symbol, types.int32(*arguments))

    def __call__(self, *arguments: int) -> int:  # type: ignore[override]
        """What the C returns, for kernels that run uncompiled."""
        pairs = zip(self._is_pointer, arguments, strict=True)
        return int(self._function(*(self._cast("void *", int(x)) if pointer else int(x) for pointer, x in pairs)))


register_default(_CFunction)(OpaqueModel)


def _both(name: str) -> tuple[_CFunction, _CFunction]:
    return _CFunction(BOUND, name), _CFunction(PAPER, name)


_poll_bound, _poll_paper = _both("phx_snode_poll")
_make_auth_s_bound, _make_auth_s_paper = _both("phx_snode_make_auth")
_check_auth_s_bound, _check_auth_s_paper = _both("phx_snode_check_auth")
_recv_bound, _recv_paper = _both("phx_anode_recv")
_send_bound, _send_paper = _both("phx_anode_send")
_actuate_bound, _actuate_paper = _both("phx_anode_actuate")
_request_bound, _request_paper = _both("phx_anode_token_request")
_issue_bound, _issue_paper = _both("phx_anode_issue_token")
_check_token_bound, _check_token_paper = _both("phx_anode_check_token")
_install_bound, _install_paper = _both("phx_anode_install_token")
_check_bound, _check_paper = _both("phx_anode_check")
_is_safe_bound, _is_safe_paper = _both("phx_anode_is_safe")
_make_auth_a_paper = _CFunction(PAPER, "phx_anode_make_auth")
_check_auth_a_paper = _CFunction(PAPER, "phx_snode_check_auth_a")
_sha1 = _CFunction(BOUND, "phx_sha1")
_extend = _CFunction(BOUND, "phx_chain_extend")
_lightmac = _CFunction(BOUND, "phx_lightmac")


@kernel
def _fits(payload: Row, length: int, entry: Row) -> bool:
    # More than FRAME_MAX the C refuses itself, before it touches the entry.
    return 0 <= length <= payload.size and min(length, FRAME_MAX) + ENTRY_HEADER_BYTES <= entry.size


@kernel
def snode_poll(profile: int, node: Row, now: int, reading: Row, length: int, entry: Row) -> int:
    """The reading is chained; `entry` is what the c-node gets and logs.

    Returns: the entry's length. Source: RoboRebound Alg. 3 (PollSensors).
    """
    if not _fits(reading, length, entry):
        return E_ARG
    if profile == BOUND:
        return _poll_bound(node.ctypes.data, now, reading.ctypes.data, length, entry.ctypes.data)
    return _poll_paper(node.ctypes.data, now, reading.ctypes.data, length, entry.ctypes.data)


@kernel
def anode_recv(profile: int, node: Row, now: int, frame: Row, length: int, entry: Row) -> int:
    """A frame from the radio may go to the c-node: `entry[7:]`, chained unless it is an AUDIT frame.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (RecvWireless).
    """
    if not _fits(frame, length, entry):
        return E_ARG
    if profile == BOUND:
        return _recv_bound(node.ctypes.data, now, frame.ctypes.data, length, entry.ctypes.data)
    return _recv_paper(node.ctypes.data, now, frame.ctypes.data, length, entry.ctypes.data)


@kernel
def anode_send(profile: int, node: Row, now: int, frame: Row, length: int, entry: Row) -> int:
    """A frame may go to the radio: `entry[7:]`, which in `bound` names this robot as source of an AUDIT frame.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (SendWireless).
    """
    if not _fits(frame, length, entry):
        return E_ARG
    if profile == BOUND:
        return _send_bound(node.ctypes.data, now, frame.ctypes.data, length, entry.ctypes.data)
    return _send_paper(node.ctypes.data, now, frame.ctypes.data, length, entry.ctypes.data)


@kernel
def anode_actuate(profile: int, node: Row, now: int, command: Row, length: int, entry: Row) -> int:
    """A command may go to the actuators: `entry[7:]`.

    Returns: the entry's length. Source: RoboRebound Alg. 4 (ActuatorCmd).
    """
    if not _fits(command, length, entry):
        return E_ARG
    if profile == BOUND:
        return _actuate_bound(node.ctypes.data, now, command.ctypes.data, length, entry.ctypes.data)
    return _actuate_paper(node.ctypes.data, now, command.ctypes.data, length, entry.ctypes.data)


@kernel
def snode_make_auth(profile: int, node: Row, nonce: Row, out: Row) -> int:
    """`out` is the record `authenticator`; the s-chain is flushed. `paper` ignores the nonce.

    Source: RoboRebound Alg. 2 (MakeAuthenticator).
    """
    if nonce.size < NONCE_BYTES or out.size < AUTH_BYTES:
        return E_ARG
    if profile == BOUND:
        return _make_auth_s_bound(node.ctypes.data, nonce.ctypes.data, out.ctypes.data)
    return _make_auth_s_paper(node.ctypes.data, nonce.ctypes.data, out.ctypes.data)


@kernel
def snode_check_auth(profile: int, node: Row, top: Row, robot_id: int, nonce: Row, mac: Row) -> int:
    """0 if robot_id's s-node made this authenticator, for this nonce. Source: RoboRebound Alg. 3."""
    if top.size < HASH_BYTES or nonce.size < NONCE_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    if profile == BOUND:
        return _check_auth_s_bound(node.ctypes.data, top.ctypes.data, robot_id, nonce.ctypes.data, mac.ctypes.data)
    return _check_auth_s_paper(node.ctypes.data, top.ctypes.data, robot_id, nonce.ctypes.data, mac.ctypes.data)


@kernel
def anode_make_auth(profile: int, node: Row, out: Row) -> int:
    """`paper` only: `out` is the record `authenticator` of the a-chain, flushed. Source: RoboRebound Alg. 2."""
    if profile != PAPER or out.size < AUTH_BYTES:
        return E_ARG
    return _make_auth_a_paper(node.ctypes.data, out.ctypes.data)


@kernel
def snode_check_auth_a(profile: int, node: Row, top: Row, robot_id: int, mac: Row) -> int:
    """`paper` only: 0 if robot_id's a-node made this authenticator. Source: RoboRebound Alg. 3."""
    if profile != PAPER or top.size < HASH_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    return _check_auth_a_paper(node.ctypes.data, top.ctypes.data, robot_id, mac.ctypes.data)


@kernel
def anode_token_request(profile: int, node: Row, now: int, tor: int, out: Row) -> int:
    """`out` is the record `token_request`; the a-chain is flushed. In `paper` the top is left out: zeros.

    Source: RoboRebound Alg. 4 (MakeTokenRequest).
    """
    if out.size < TREQ_BYTES:
        return E_ARG
    if profile == BOUND:
        return _request_bound(node.ctypes.data, now, tor, out.ctypes.data)
    return _request_paper(node.ctypes.data, now, tor, out.ctypes.data)


@kernel
def anode_issue_token(profile: int, node: Row, tee: int, t: int, top: Row, treq_mac: Row, hckpt: Row, mac: Row) -> int:
    """`mac` is the token for `tee`'s request: the caller has replayed its log up to `top` and found no fault.

    Source: RoboRebound Alg. 4 (IssueToken).
    """
    if top.size < HASH_BYTES or treq_mac.size < MAC_BYTES or hckpt.size < HASH_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    a, b, c, d, e = node.ctypes.data, top.ctypes.data, treq_mac.ctypes.data, hckpt.ctypes.data, mac.ctypes.data
    if profile == BOUND:
        return _issue_bound(a, tee, t, b, c, d, e)
    return _issue_paper(a, tee, t, b, c, d, e)


@kernel
def anode_check_token(profile: int, node: Row, tor: int, tee: int, t: int, hckpt: Row, mac: Row) -> int:
    """0 if `tor` issued this token to `tee`. Source: RoboRebound Alg. 4 (IsTokenValid, with the auditee named)."""
    if hckpt.size < HASH_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    if profile == BOUND:
        return _check_token_bound(node.ctypes.data, tor, tee, t, hckpt.ctypes.data, mac.ctypes.data)
    return _check_token_paper(node.ctypes.data, tor, tee, t, hckpt.ctypes.data, mac.ctypes.data)


@kernel
def anode_install_token(profile: int, node: Row, now: int, tor: int, t: int, hckpt: Row, mac: Row) -> int:
    """0: the token counts from now on until it is too old. Source: RoboRebound Alg. 4 (InstallToken)."""
    if hckpt.size < HASH_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    if profile == BOUND:
        return _install_bound(node.ctypes.data, now, tor, t, hckpt.ctypes.data, mac.ctypes.data)
    return _install_paper(node.ctypes.data, now, tor, t, hckpt.ctypes.data, mac.ctypes.data)


@kernel
def anode_check(profile: int, node: Row, now: int) -> int:
    """0, or 1: in Safe Mode, now or already. Source: RoboRebound Alg. 4 (CheckTokens)."""
    if profile == BOUND:
        return _check_bound(node.ctypes.data, now)
    return _check_paper(node.ctypes.data, now)


@kernel
def anode_is_safe(profile: int, node: Row) -> int:
    """1 in Safe Mode. Source: RoboRebound §3.1."""
    if profile == BOUND:
        return _is_safe_bound(node.ctypes.data)
    return _is_safe_paper(node.ctypes.data)


@kernel
def sha1(data: Row, length: int, out: Row) -> int:
    """`out` is the hash of `data[:length]`. Source: FIPS 180."""
    if not 0 <= length <= data.size or out.size < HASH_BYTES:
        return E_ARG
    return _sha1(data.ctypes.data, length, out.ctypes.data)


@kernel
def chain_extend(top: Row, data: Row, length: int) -> int:
    """`top` becomes H(top ‖ data[:length]): one flush of a chain. Source: RoboRebound Alg. 2 (FlushBuffer)."""
    if not 0 <= length <= data.size or top.size < HASH_BYTES:
        return E_ARG
    return _extend(top.ctypes.data, data.ctypes.data, length)


@kernel
def lightmac(key: Row, message: Row, length: int, mac: Row) -> int:
    """`mac` is that of `message[:length]`, at most 1791 bytes, under K1 ‖ K2. Source: Luykx et al., FSE 2016."""
    if not 0 <= length <= message.size or key.size < KEY_BYTES or mac.size < MAC_BYTES:
        return E_ARG
    return _lightmac(key.ctypes.data, message.ctypes.data, length, mac.ctypes.data)
