"""Check a kept log against the MACs of the robot's trusted nodes; needs the mission key.

After each audit request, a kept log has the head of the request: the tops of both chains, which cover everything that
the nodes let through, and the nodes' MACs over them. The owner of the keys re-hashes the log and compares. Up to the
last proof the log is what the nodes recorded, even if the robot's computer is compromised; later entries are unproven.
Source: RoboRebound §3.4, §3.7; docs/spec/rebound-nodes.md, docs/spec/rebound.md.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phalanx.bti import log, trusted
from phalanx.bti.nodes import MissionKey
from phalanx.errors import UsageError
from phalanx.net.keyring import open_keyring
from phalanx.net.mission_key import read_mission_key
from phalanx.robot.retrace import entries_of
from phalanx.wire import guarded
from phalanx.wire.driven import GATEWAY, KIND_ORDER, OPERATOR, ORDER, SIGNATURE_BYTES
from phalanx.wire.fields import row
from phalanx.wire.table import (
    AUTH_S,
    ENTRY_HEADER_BYTES,
    ENTRY_INPUT,
    ENTRY_RECV,
    HASH_BYTES,
    KEY_BYTES,
    MAC_BYTES,
    MKEY,
    PROOF,
    REQUEST,
    TREQ,
)

from .evidence import RobotLog

# Signers of messages that a robot received, checked with the public keys in the mission's file.
NOBODY, UNKNOWN = "nobody whom the mission names", "somebody: too many to look at"
MOST_LOOKS = 50_000  # signatures to check: a hostile log has 700 000, an hour of joystick orders 20 000
AT_SIGNER = ORDER.at("signer")
HEAD = [field.name for field in REQUEST.all_fields if field.type != "rest"]


@dataclass(frozen=True, slots=True)
class ProofResult:
    """Result of the check: number of proven entries from the beginning, and the first false proof, if any.

    `t_ms` is the time of the last valid proof, by the a-node's clock; 0 without one.
    """

    entries: int
    t_ms: int
    false_at: int | None  # number of entries before a proof that contradicts them

    @property
    def holds(self) -> bool:
        """Return whether an entry is proven, and none disproved."""
        return self.entries > 0 and self.false_at is None


def mission_key_of(kept: RobotLog, keys_file: Path, passphrase: str, issued: Path) -> bytes:
    """Return the secret key of the log's mission, 20 bytes. Raises: UsageError: a wrong file; Unavailable."""
    sealed = read_mission_key(issued, kept.robot)
    if sealed.seq != kept.mission:
        raise UsageError(f"{issued} is of mission {sealed.seq}", f"use the file of mission {kept.mission}")
    with open_keyring(keys_file, passphrase) as keys:
        master = keys.master(kept.robot)
    return unsealed(master, sealed)


def unsealed(master: bytes, sealed: MissionKey) -> bytes:
    """Return the mission key, decrypted with a master key. Raises: UsageError: it was sealed with another one."""
    if not hmac.compare_digest(mac_of(master, MKEY.encode(k=sealed.k, r=sealed.r, seq=sealed.seq)), sealed.mac):
        raise UsageError("the mission's key was issued with other keys", "use those that provisioned the robot")
    blind = hashlib.sha1(sealed.r + master, usedforsecurity=False).digest()
    return bytes(a ^ b for a, b in zip(sealed.k, blind, strict=True))


def mac_of(key: bytes, message: bytes) -> bytes:
    """Return the MAC of these bytes, as trusted nodes with this key compute it. Source: docs/spec/rebound-nodes.md."""
    mac = np.zeros(MAC_BYTES, np.uint8)
    assert len(key) == KEY_BYTES
    trusted.lightmac(row(key), row(message), len(message), mac)
    return mac.tobytes()


def check_proofs(kept: RobotLog, mission_key: bytes) -> ProofResult:
    """Return how much of a log its nodes' MACs prove. Source: RoboRebound Alg. 2, 4; docs/spec/rebound-nodes.md."""
    tops = [bytes(HASH_BYTES)] * 2
    held: tuple[list[bytes], list[bytes]] = ([], [])
    count = entries = t_ms = 0
    batch: int = kept.scenario.bti.batch_size

    def flush(chain: int) -> None:
        if held[chain]:
            tops[chain] = hashlib.sha1(tops[chain] + b"".join(held[chain]), usedforsecurity=False).digest()
            held[chain].clear()

    for each in entries_of(kept.raw):
        raw = kept.raw[each.at : each.end]
        if each.kind == PROOF.tag:
            message = PROOF.decode(raw)
            head = dict(zip(HEAD, REQUEST.form.unpack(message["head"]), strict=True))
            if held[0] or held[1] or not _is_true(mission_key, kept.robot, tops, message["auditor"], head):
                return ProofResult(entries, t_ms, count)
            entries, t_ms = count, int(head["t"])
            continue
        count += 1
        if each.kind in (log.FLUSH_S, log.FLUSH_A):
            flush(each.kind - log.FLUSH_S)
        elif not each.kind & log.MARK:
            chain = 0 if each.kind == ENTRY_INPUT else 1
            held[chain].append(raw)
            if len(held[chain]) == batch:
                flush(chain)
    return ProofResult(entries, t_ms, None)


def _is_true(key: bytes, robot: int, tops: list[bytes], auditor: int, head: dict[str, Any]) -> bool:
    """Return whether both nodes made MACs over these tops, the s-node's for the a-node's request."""
    asked = mac_of(key, TREQ.encode(t=head["t"], auditee=robot, auditor=auditor, thash_a=tops[1]))
    shown = mac_of(key, AUTH_S.encode(thash=tops[0], id=robot, nonce=asked))
    return hmac.compare_digest(asked, head["treq_mac"]) and hmac.compare_digest(shown, head["auth_s_mac"])


@dataclass(slots=True)
class Signed:
    """Messages of one signer in a log, duplicates excluded; times are seconds since the mission key."""

    signer: str
    key: str  # public, hexadecimal; "" if unknown
    count: int
    first_s: float
    last_s: float


def count_signed_messages(kept: RobotLog) -> list[Signed]:
    """Group the signed messages in a log by signer, in order of first receipt; NOBODY for forged ones."""
    found: dict[str, Signed] = {}
    seen: set[bytes] = set()
    for t_ms, message, keys in _signed_messages(kept):
        if message in seen:  # stops are repeated, and delayed messages arrive twice
            continue
        signer = UNKNOWN
        if len(seen) < MOST_LOOKS:
            seen.add(message)
            signer = next((name for name, key in keys.items() if _is_by(key, message)), NOBODY)
        at_s = (t_ms - kept.t_key_ms) / 1000
        entry = found.setdefault(signer, Signed(signer, keys.get(signer, ""), 0, at_s, at_s))
        entry.count += 1
        entry.last_s = at_s
    return list(found.values())


def _signed_messages(kept: RobotLog) -> Iterator[tuple[int, bytes, dict[str, str]]]:
    """Yield the time and bytes of each signed message, and the public keys of its possible signers."""
    scenario, now_ms = kept.scenario, kept.t_key_ms
    signers = {GATEWAY: ("gateway", scenario.gateway_key), OPERATOR: ("operator", scenario.operator_key)}
    for each in kept.entries():
        now_ms = max(now_ms, each.t_ms)
        if each.kind == ENTRY_RECV:
            message = kept.raw[each.at + ENTRY_HEADER_BYTES : each.end]
            if len(message) >= ORDER.size + SIGNATURE_BYTES and message[0] == KIND_ORDER:
                named = signers.get(message[AT_SIGNER])
                yield now_ms, message, dict([named] if named else [])
        elif each.kind == log.ADVICE:
            message = kept.raw[each.at + guarded.ADVICE.size : each.end]
            if len(message) == guarded.SIGNED_BYTES and message[0] == guarded.KIND_SIGNED_WISH:
                yield now_ms, message, {"adviser": scenario.guard.adviser_key}


def _is_by(key: str, message: bytes) -> bool:
    return bool(key) and trusted.order_check(row(bytes.fromhex(key)), row(message), len(message)) == 0
