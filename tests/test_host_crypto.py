"""Simulators hash and encrypt faster than robots do, and to the same bytes; everybody else has the firmware's C."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle.lightmac import lightmac
from phalanx.bti import trusted
from phalanx.config import BtiConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

VECTORS = Path(__file__).parent.parent / "vectors"
HASHES, ENCRYPTS = 1, 2
PROFILES = (trusted.HARDENED, trusted.PAPER)
CAN = trusted.FIRMWARE[trusted.HARDENED][1].phx_host_can()
needs = {
    able: pytest.mark.skipif(not CAN & able, reason="this processor leaves it to the firmware's C")
    for able in (HASHES, ENCRYPTS)
}


@pytest.fixture(autouse=True)
def _fast():
    """Each test begins with the host's, and leaves the firmware's behind."""
    use(1)
    yield
    use(0)


def use(fast):
    for profile in PROFILES:
        assert trusted.host_use(profile, fast) == (CAN if fast else 0)


def sha1(profile, pieces):
    """A chain's hash, as a node's batches come: the pieces one after the other."""
    ffi, lib = trusted.FIRMWARE[profile]
    top = bytearray(hashlib.sha1(b"").digest())
    for piece in pieces:
        lib.phx_chain_extend(ffi.from_buffer("uint8_t[]", top), piece, len(piece))
    return bytes(top)


def mac(profile, key, message):
    ffi, lib = trusted.FIRMWARE[profile]
    told = bytearray(8)
    return lib.phx_lightmac(key, message, len(message), ffi.from_buffer("uint8_t[]", told)), bytes(told)


def both(compute, *arguments):
    """What the host computes, which is what the firmware does, in either profile."""
    told = set()
    for fast in (1, 0):
        use(fast)
        told |= {compute(profile, *arguments) for profile in PROFILES}
    assert len(told) == 1
    return told.pop()


@needs[HASHES]
@pytest.mark.parametrize(
    "case", json.loads((VECTORS / "sha1.json").read_text())["cases"], ids=lambda case: case["name"]
)
def test_published_hashes(case):
    message, digest = np.frombuffer(bytes.fromhex(case["message"]) * case["times"], np.uint8), np.zeros(20, np.uint8)
    trusted.sha1(message, len(message), digest)
    assert digest.tobytes().hex() == case["digest"]


@needs[ENCRYPTS]
@pytest.mark.parametrize(
    "case", json.loads((VECTORS / "lightmac.json").read_text())["cases"], ids=lambda case: case["name"]
)
def test_the_oracles_macs(case):
    code, told = both(mac, bytes.fromhex(case["key"]), bytes.fromhex(case["message"]))
    assert (told.hex() == case["mac"]) if case["expect"] == "ok" else code < 0


@needs[HASHES]
@given(st.lists(st.one_of(st.binary(max_size=200), st.integers(0, 2100).map(bytes)), max_size=5))
def test_hashes_of_anything_are_those_of_the_firmware_and_of_everybody_else(pieces):
    top = hashlib.sha1(b"").digest()
    for piece in pieces:
        top = hashlib.sha1(top + piece).digest()
    assert both(sha1, pieces) == top


@needs[ENCRYPTS]
@given(st.binary(min_size=20, max_size=20), st.integers(0, 200), st.randoms(use_true_random=False))
def test_macs_of_anything_are_those_of_the_firmware(key, size, chance):
    message = chance.randbytes(size)
    assert both(mac, key, message) == (0, lightmac(key, message))


@needs[ENCRYPTS]
def test_macs_of_every_length_that_there_is():
    message = np.random.default_rng(1).bytes(1793)
    codes = [both(mac, message[:20], message[:size])[0] for size in [*range(120), *range(1700, 1794)]]
    assert codes[-3:] == [0, trusted.FIRMWARE[0][1].PHX_E_TOO_LONG, trusted.FIRMWARE[0][1].PHX_E_TOO_LONG]
    assert set(codes[:-2]) == {0}


@needs[ENCRYPTS]
def test_a_mac_that_is_asked_for_again_is_that_of_its_key_and_its_bytes():
    """Of short messages the host keeps what it made, and of keys the last two."""
    keys = [bytes([k]) * 20 for k in range(3)]
    messages = [bytes(size) for size in (0, 1, 2, 31, 32, 33)] + [bytes([k]) + bytes(28) for k in range(60)]
    for _ in range(2):
        for key in keys:
            assert {message: mac(trusted.HARDENED, key, message)[1] for message in messages} == {
                message: lightmac(key, message) for message in messages
            }


def test_what_is_hashed_in_part_may_be_gone_on_with_by_the_other():
    """A run that is plain may follow one that is not, in one process and over the same nodes."""
    scenario = Scenario(robots=4, duration_s=9.0, bti=BtiConfig(f_max=1), attacks=(AttackSpec(name="flee", robot=2),))
    told = []
    for order in ((0, 0, 0), (0, 1, 0), (1, 1, 1)):
        run = Run(scenario)
        for k, plain in enumerate(order):
            run.world.fleet.settings[0].plain = plain
            run.advance(3.0 * (k + 1))
        told.append(run.summary()["digest"])
    assert len(set(told)) == 1


@pytest.mark.parametrize("plain", [False, True])
def test_only_a_simulation_that_is_not_plain_computes_so(plain):
    use(0)
    Run(Scenario(robots=2, duration_s=1.0, bti=BtiConfig(f_max=1)), plain=plain).advance(0.1)
    _, lib = trusted.FIRMWARE[trusted.HARDENED]
    assert lib.phx_host_used() == (0 if plain else CAN)


@needs[HASHES]
@needs[ENCRYPTS]
def test_what_is_computed_is_counted_by_the_block():
    before = trusted.counted()
    message, told = np.zeros(200, np.uint8), np.zeros(20, np.uint8)
    trusted.sha1(message, 200, told)  # 200 + 9 bytes
    trusted.lightmac(message[:20], message[:50], 50, told)  # 7 bytes a block, and the last
    use(0)
    trusted.sha1(message, 200, told)
    assert [now - then for then, now in zip(before, trusted.counted(), strict=True)] == [4, 8]
