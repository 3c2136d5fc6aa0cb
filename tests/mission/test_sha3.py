"""Batched SHA3-256 says what hashlib says, and the search among many messages what a search with hashlib says."""

from __future__ import annotations

import hashlib
import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.crypto.keys import scrypt
from phalanx.crypto.sha3 import Targets, find_patched, sha3_256


def test_the_published_digests_of_nothing_and_abc():
    assert sha3_256(b"").hex() == "a7ffc6f8bf1ed76651c14756a061d662f580ff4de43b49fa82d80a4b80f8434a"
    assert sha3_256(b"abc").hex() == "3a985da74fe225b2045c172d6bd390bd855f086e3e9d525b46bfe24511431532"


@settings(max_examples=80, deadline=None)
@given(
    st.binary(max_size=180),
    st.binary(max_size=180),
    st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=40, unique=True),
    st.data(),
)
def test_a_compiled_search_finds_what_the_plain_one_finds(before, after, patches, data):
    wanted = data.draw(st.lists(st.sampled_from(patches), max_size=3, unique=True))
    others = [bytes([i]) * 32 for i in range(data.draw(st.integers(0, 5)))]
    full = [hashlib.sha3_256(before + struct.pack("<Q", patch) + after).digest() for patch in patches]
    digests = [*others, *(full[patches.index(patch)] for patch in wanted)]
    plain = next(((i, digests.index(digest)) for i, digest in enumerate(full) if digest in digests), None)
    message = before + bytes(8) + after
    found = find_patched(message, len(before), np.array(patches, np.uint64), Targets(digests))
    assert found == plain


def test_targets_that_share_their_first_lane_are_told_apart():
    patches = np.arange(20, dtype=np.uint64)
    digest = hashlib.sha3_256(struct.pack("<Q", 11)).digest()
    lookalike = digest[:8] + bytes(24)
    assert find_patched(bytes(8), 0, patches, Targets([lookalike])) is None
    assert find_patched(bytes(8), 0, patches, Targets([lookalike, digest, lookalike])) == (11, 1)


def test_no_targets_and_no_patches_find_nothing():
    assert find_patched(bytes(8), 0, np.arange(9, dtype=np.uint64), Targets([])) is None
    assert find_patched(bytes(8), 0, np.arange(0, dtype=np.uint64), Targets([bytes(32)])) is None


def test_scrypt_is_the_published_one():
    # RFC 7914 §12, the vector with p = 1 that needs least memory: r = 8 and N = 16384.
    out = scrypt(b"pleaseletmein", b"SodiumChloride", log2_n=14, r=8, length=64)
    assert out.hex().startswith("7023bdcb3afd7348461c06cd81fd38eb")
