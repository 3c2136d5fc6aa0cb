"""TrustZone-M in QEMU (AN505): a c-node that was taken over drives its robot until t_val, or faults, and no further.

The nodes are in the secure world, unmodified, with SysTick and the motor register; the c-node has one door to them. Both
worlds say at UARTs of their own what happens: firmware/ports/trustzone/.
"""

from __future__ import annotations

import subprocess
import time

import pytest

import boards
from phalanx.net.children import die_with_parent

# As in test_qemu.py: whose board has no work polls its line.
pytestmark = [pytest.mark.timeout(900), pytest.mark.waits]
T_VAL_MS, CHECK_MS = 500, 10
KEYED_MS = 20  # from power-up to the mission key, at most: the c-node has nothing to wait for
WHICH = 0x28100000  # where the c-node looks for what to do, by number
BEGUN = ["hello +00000", "mission +00000", "drive +00011"]
REFUSED = " -00066"
(
    HONEST,
    HOLD_ON,
    REPEAT,
    SLEEP,
    WRITE_MOTORS,
    WRITE_MOTORS_SECURE,
    WRITE_NODES,
    READ_NODES,
    JUMP_INSIDE,
    JUMP_BESIDE,
) = range(10)
POINTERS, RESET, HANDLERS, PREEMPT, REENTER = range(10, 15)


def lived(folder, which: int) -> tuple[dict[str, int], list[str]]:
    """When the motors went on and off, ms, and what the c-node said until half a second later."""
    boards.built("trustzone-cnode.elf")
    words = ["-device", f"loader,file={boards.built('trustzone-cnode.elf')}"]
    words += ["-device", f"loader,addr={WHICH:#x},data={which},data-len=4"]
    words += ["-serial", "file:secure", "-serial", "file:c-node", "-display", "none", "-monitor", "none"]
    process = subprocess.Popen(
        ["qemu-system-arm", "-M", "mps2-an505", "-kernel", str(boards.built("trustzone.elf")), *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        preexec_fn=die_with_parent,
    )
    secure, c_node = folder / "secure", folder / "c-node"
    end_s = time.monotonic() + 300
    while time.monotonic() < end_s and not (secure.exists() and secure.read_text().count("\n") >= 2):
        time.sleep(0.05)
    time.sleep(0.5)  # whoever goes on is seen to
    process.kill()
    process.wait()
    told = secure.read_text().splitlines()
    assert [line.rpartition(" ")[0] for line in told] == ["motors on", "motors off"], told
    return {line.split()[1]: int(line.split()[2]) for line in told}, c_node.read_text().splitlines()


def long(which: int, name: str):
    """More of the same: each of these costs a second of QEMU's."""
    return pytest.param(which, marks=pytest.mark.long, id=name)


@pytest.mark.parametrize(
    "which",
    [
        pytest.param(HOLD_ON, id="hold on"),
        pytest.param(PREEMPT, id="preempt"),
        long(REPEAT, "repeat"),
        long(SLEEP, "sleep"),
    ],
)
def test_a_c_node_that_turns_its_interrupts_off_and_drives_for_ever_is_stopped_at_t_val(which, tmp_path):
    motors, said = lived(tmp_path, which)
    assert T_VAL_MS <= motors["off"] <= KEYED_MS + T_VAL_MS + CHECK_MS
    assert said[:3] == BEGUN
    assert said[3:] == (["refused -00002", "done +00002"] if which == REPEAT else []), (
        "Safe Mode refuses who still asks"
    )


@pytest.mark.parametrize(
    "which",
    [WRITE_MOTORS, WRITE_MOTORS_SECURE, WRITE_NODES, READ_NODES, JUMP_INSIDE, JUMP_BESIDE, HANDLERS],
    ids=["motors", "motors' other address", "nodes' memory", "keys", "inside", "beside the gate", "own handlers"],
)
def test_whoever_reaches_into_the_secure_world_faults_and_the_motors_stop_within_a_check(which, tmp_path):
    motors, said = lived(tmp_path, which)
    assert motors["off"] <= motors["on"] + CHECK_MS
    assert said == BEGUN, "it never went on"


def test_pointers_into_the_secure_world_are_refused_and_others_work_on(tmp_path):
    motors, said = lived(tmp_path, POINTERS)
    wrong = [
        "from secure",
        "to secure",
        "to motors",
        "over the edge",
        "around the end",
        "too long",
        "too short",
        "no room",
    ]
    assert said == [*BEGUN, *(each + REFUSED for each in wrong), "drive +00011", "done +00010"]
    assert motors["off"] >= T_VAL_MS


def test_an_interrupt_that_calls_the_gate_again_and_again_never_does_so_inside(tmp_path):
    motors, said = lived(tmp_path, REENTER)
    assert said == [*BEGUN, "refused -00002", "mixed up +00000", "entered +00001", f"done +{REENTER:05}"]
    assert T_VAL_MS <= motors["off"] <= KEYED_MS + T_VAL_MS + CHECK_MS


def test_a_reset_is_not_the_c_nodes_to_make(tmp_path):
    motors, said = lived(tmp_path, RESET)
    assert said == [*BEGUN, "still here +00011", f"done +{RESET:05}"]
    assert T_VAL_MS <= motors["off"] <= KEYED_MS + T_VAL_MS + CHECK_MS


@pytest.mark.long
def test_a_c_node_that_does_nothing_more_is_stopped_at_t_val_as_well(tmp_path):
    motors, said = lived(tmp_path, HONEST)
    assert said == [*BEGUN, "done +00000"]
    assert T_VAL_MS <= motors["off"] <= KEYED_MS + T_VAL_MS + CHECK_MS
