"""The trusted nodes on the microcontrollers they are made for: instructions counted one by one, the same for any key."""

from __future__ import annotations

import json
from hashlib import sha1

import pytest

from commands import ROOT
from oracle.lightmac import lightmac

FIRMWARE = ROOT / "firmware"
COMMITTED = json.loads((ROOT / "src" / "phalanx" / "data" / "instructions.json").read_text())
# The aim, for the MACs that nodes make (tokens, authenticators, mission keys; seals have four blocks) and longer ones.
MOST_A_BLOCK = 1200


@pytest.fixture(scope="module")
def count():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FIRMWARE))
        import count

        yield count


@pytest.fixture(scope="module", params=["cortex-m3", "mips32"])
def machine(count, request):
    made = count.Machine(request.param, FIRMWARE)
    made.target = request.param
    return made


def mac_of(machine, key, message):
    """The MAC, and the way there."""
    out, expanded = machine.keep(bytes(8)), machine.keep(bytes(512))
    machine.call("phx_mac_expand", expanded, key)
    way = machine.way
    machine.call("phx_mac", expanded, message, len(message), out)
    return machine.read(out, 8), (way, machine.way)


@pytest.mark.parametrize("length", [0, 6, 7, 13, 14, 20, 29, 45])
def test_macs_and_hashes_are_right_there(machine, length):
    key, message, out = bytes(range(20)), bytes(7 * n % 256 for n in range(length)), machine.keep(bytes(20))
    assert mac_of(machine, key, message)[0] == lightmac(key, message)
    machine.call("phx_sha1", message, length, out)
    assert machine.read(out, 20) == sha1(message).digest()


def test_which_instructions_run_depends_on_no_key_and_no_message(machine):
    ways = {mac_of(machine, bytes([n] * 20), bytes([255 - n] * 31))[1] for n in (0, 1, 127, 255)}
    assert len(ways) == 1
    assert mac_of(machine, bytes(20), bytes(38))[1] not in ways, "on the length it does"


@pytest.mark.parametrize("target", ["cortex-m3", pytest.param("mips32", marks=pytest.mark.long)])
def test_the_counts_are_those_that_are_told(count, target):
    told, counted = COMMITTED[target], count.counted(target, FIRMWARE)
    for group in ("mac", "hash", "calls"):
        assert list(counted[group]) == list(told[group])
        for name, number in counted[group].items():
            # Another version of the compiler may need a little more or less.
            assert number == pytest.approx(told[group][name], rel=0.1), f"{name}: python firmware/count.py --write"


@pytest.mark.long
def test_what_a_look_at_an_order_takes_is_what_is_told(count):
    assert count.order_check(FIRMWARE) == pytest.approx(COMMITTED["cortex-m3"]["order"], rel=0.1)


def test_a_block_takes_no_more_than_was_asked(machine):
    told = COMMITTED[machine.target]["mac"]
    for length in (29, 31, 45, 64, 128, 256, 512, 1024):
        assert told[str(length)] / (length // 7 + 1) <= MOST_A_BLOCK
