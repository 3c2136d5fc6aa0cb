"""What a robot's trusted nodes said of its kept log, checked by whoever has the mission key.

A kept log has, after each request for an audit, what the request began with: the tops of both chains, which hold all
that the nodes ever let through, and the nodes' MACs over them. Who has the owner's keys re-hashes the log and compares:
up to the last proof it is what the nodes saw, whatever the robot's computer would have it be. Behind it nothing is.
Source: RoboRebound §3.4, §3.7; docs/spec/rebound.md.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phalanx.bti import log, trusted
from phalanx.bti.nodes import MissionKey
from phalanx.errors import UsageError
from phalanx.io.keyring import opened
from phalanx.io.mission_key import read_mission_key
from phalanx.robot.retrace import entries_of
from phalanx.wire.fields import row
from phalanx.wire.table import AUTH_S, ENTRY_INPUT, HASH_BYTES, KEY_BYTES, MAC_BYTES, MKEY, PROOF, REQUEST, TREQ

from .evidence import Kept

HEAD = [field.name for field in REQUEST.all_fields if field.type != "rest"]


@dataclass(frozen=True, slots=True)
class Proven:
    """Up to where a log is proven, in entries from its beginning, and which proof is not the nodes' own, if any.

    `t_ms` is when the last true proof was made, of the a-node's clock; 0 without one.
    """

    entries: int
    t_ms: int
    false_at: int | None  # of so many entries before it, a proof says other than what is there

    @property
    def holds(self) -> bool:
        """Whether anything is proven, and nothing disproved."""
        return self.entries > 0 and self.false_at is None


def mission_key_of(kept: Kept, keys_file: Path, passphrase: str, issued: Path) -> bytes:
    """The key of the log's mission, 20 bytes: secret; of the robot's master key, and of what was issued for it.

    Raises: UsageError: the file of keys, or of the mission's key, is none, or another's; Unavailable.
    """
    sealed = read_mission_key(issued, kept.robot)
    if sealed.seq != kept.mission:
        raise UsageError(f"{issued} is of mission {sealed.seq}", f"the log is of mission {kept.mission}")
    with opened(keys_file, passphrase) as keys:
        master = keys.master(kept.robot)
    return unsealed(master, sealed)


def unsealed(master: bytes, sealed: MissionKey) -> bytes:
    """The mission key, as trusted nodes with this master key have it. Raises: UsageError: it was sealed for others."""
    if not hmac.compare_digest(mac_of(master, MKEY.encode(k=sealed.k, r=sealed.r, seq=sealed.seq)), sealed.mac):
        raise UsageError("the mission's key was issued with other keys", "those with which the robot was provisioned")
    blind = hashlib.sha1(sealed.r + master, usedforsecurity=False).digest()
    return bytes(a ^ b for a, b in zip(sealed.k, blind, strict=True))


def mac_of(key: bytes, message: bytes) -> bytes:
    """The MAC that trusted nodes with this key make of these bytes. Source: docs/spec/rebound-nodes.md."""
    mac = np.zeros(MAC_BYTES, np.uint8)
    assert len(key) == KEY_BYTES
    trusted.lightmac(row(key), row(message), len(message), mac)
    return mac.tobytes()


def proven(kept: Kept, mission_key: bytes) -> Proven:
    """Up to where the nodes' own MACs are over what the log says.

    Source: RoboRebound Alg. 2 (chains), Alg. 4 (MakeTokenRequest); docs/spec/rebound-nodes.md.
    """
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
            said = PROOF.decode(raw)
            head = dict(zip(HEAD, REQUEST.form.unpack(said["head"]), strict=True))
            if held[0] or held[1] or not _is_true(mission_key, kept.robot, tops, said["tor"], head):
                return Proven(entries, t_ms, count)
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
    return Proven(entries, t_ms, None)


def _is_true(key: bytes, robot: int, tops: list[bytes], tor: int, head: dict[str, Any]) -> bool:
    """Whether both nodes made MACs over these tops, the s-node's for the a-node's request."""
    asked = mac_of(key, TREQ.encode(t=head["t"], tee=robot, tor=tor, thash_a=tops[1]))
    shown = mac_of(key, AUTH_S.encode(thash=tops[0], id=robot, nonce=asked))
    return hmac.compare_digest(asked, head["treq_mac"]) and hmac.compare_digest(shown, head["auth_s_mac"])
