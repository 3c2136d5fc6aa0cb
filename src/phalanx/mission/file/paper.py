"""The paper profile's hashes, as printed: unsalted SHA3-256, with tags and lengths for the paper's "+".

They commit to what they encode and hide nothing from whoever tries all of it (docs/spec/mission.md says how long that
takes). What the paper does not have is the binding: it holds a record and the header to the observation, so that a file
which is changed anywhere does not decode there, signed or not.
"""

from __future__ import annotations

from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.observable import Action, Direction
from phalanx.wire import missions as table

from .canonical import canonical, with_direction
from .records import Header, NodeRecord, Profile


def node_hash(observed: bytes) -> bytes:
    """H_i of a node's canonical bytes. Source: Encoded graphs §IV-A, Fig. 6."""
    return sha3_256(observed)


def direction_hash(observed: bytes, sector: int, sectors: int) -> bytes:
    """H_ij of a way that is a direction: the node's bytes, and the direction after them.

    Source: Encoded graphs §IV-A, Fig. 6.
    """
    return sha3_256(with_direction(observed, Direction(sector, sectors)))


def action_hash(mark: bytes, action: Action) -> bytes:
    """H_ij of a way that is an action: H(H_i + action). Source: Encoded graphs §III-A, Fig. 2."""
    return sha3_256(canonical(previous=mark, action=action))


def message_of(observed: bytes, index: int) -> bytes:
    """C_ij: the message that the `index`-th send of a node gives out; made of what was sensed there.

    Source: Encoded graphs §III-B-3 ("generated as a function of the features sensed").
    """
    return sha3_256(table.MESSAGE + table.NTH.form.pack(index) + observed)


def binding(header: Header, node: int, record: NodeRecord, observed: bytes) -> bytes:
    """What ties a node's record, its number and the header to what is observed there."""
    core = record.core(Profile.PAPER)
    return sha3_256(table.BINDING + header.digest + table.BOUND.form.pack(node, len(observed)) + observed + core)
