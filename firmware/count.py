"""Instructions that calls of the trusted nodes take on the microcontrollers they are made for, counted one by one.

    python firmware/count.py [--sources FOLDER] [--write]

The objects are those of `make targets` (-Os, profile `hardened`), linked with a memcpy and a memset of a loop each. The
processor is unicorn's, which is QEMU's: every instruction that it begins is counted, whatever it would take in cycles.
--write puts the counts where `phalanx reproduce bti-fig5` reads them; tests/test_firmware_targets.py counts again.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import unicorn
from unicorn import arm_const, mips_const

HERE = Path(__file__).parent
COUNTS = HERE.parent / "src" / "phalanx" / "data" / "instructions.json"
SOURCES = "hash mac bucket node snode anode hardened seal".split()
PREFIX = {"cortex-m3": "arm-none-eabi-", "mips32": "mipsel-linux-gnu-"}
CODE, STACK, RETURN = 0x10000, 0x1F0000, 0xFFF0
MEMORY = """
#include <stddef.h>
void *memcpy(void *to, const void *from, size_t n)
{ unsigned char *a = to; const unsigned char *b = from; while (n--) *a++ = *b++; return to; }
void *memset(void *to, int c, size_t n) { unsigned char *a = to; while (n--) *a++ = (unsigned char)c; return to; }
"""
# What fig. 5 measures: lengths of what is hashed or has a MAC, bytes.
MAC_BYTES = (7, 14, 29, 31, 39, 45, 64, 128, 256, 512, 1024)
HASH_BYTES = (16, 32, 64, 128, 270, 512, 1024, 2048)


class Machine:
    """One processor with the nodes in its memory.

    Attributes:
        way: of the last call, a number made of the addresses of all its instructions, in order.
    """

    def __init__(self, target: str, sources: Path, beside: Iterable[Path] = ()) -> None:
        """`beside` the nodes: further sources in C."""
        self._arm = target == "cortex-m3"
        with tempfile.TemporaryDirectory() as folder:
            program, self._symbols = linked(target, sources, Path(folder), beside)
        if self._arm:
            mode = unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
            self._uc = unicorn.Uc(unicorn.UC_ARCH_ARM, mode)
            names = ("R0", "R1", "R2", "R3", "SP", "LR")
            registers = [getattr(arm_const, f"UC_ARM_REG_{name}") for name in names]
        else:
            mode = unicorn.UC_MODE_MIPS32 | unicorn.UC_MODE_LITTLE_ENDIAN
            self._uc = unicorn.Uc(unicorn.UC_ARCH_MIPS, mode)
            names = ("A0", "A1", "A2", "A3", "SP", "RA")
            registers = [getattr(mips_const, f"UC_MIPS_REG_{name}") for name in names]
        *self._arguments, self._sp, self._return = registers
        self._uc.mem_map(0, 0x200000)
        for address, data in program:
            self._uc.mem_write(address, data)
        self._free = 0x100000

    def keep(self, data: bytes) -> int:
        """The address of these bytes."""
        at = self._free
        self._free += -(-len(data) // 16) * 16
        self._uc.mem_write(at, data)
        return at

    def read(self, at: int, size: int) -> bytes:
        """What is there."""
        return bytes(self._uc.mem_read(at, size))

    def write(self, at: int, data: bytes) -> None:
        """These bytes are there."""
        self._uc.mem_write(at, data)

    def call(self, name: str, *arguments: int | bytes) -> tuple[int, int]:
        """What a function returned, and the instructions it took with all that it called."""
        words = [each if isinstance(each, int) else self.keep(each) for each in arguments]
        in_registers = len(self._arguments)
        spilled = words[in_registers:]
        # MIPS keeps room for the four that are in registers.
        sp = STACK - 256
        self._uc.mem_write(sp + (0 if self._arm else 16), struct.pack(f"<{len(spilled)}I", *spilled))
        for register, word in zip(self._arguments, words[:in_registers], strict=False):
            self._uc.reg_write(register, word)
        address = self._symbols[name]
        self._uc.reg_write(self._sp, sp)
        self._uc.reg_write(self._return, RETURN | self._arm)
        count, self.way = 0, 0

        def begun(_uc: Any, at: int, *_: Any) -> None:
            nonlocal count
            count += 1
            self.way = hash((self.way, at))

        hook = self._uc.hook_add(unicorn.UC_HOOK_CODE, begun)
        self._uc.emu_start(address | self._arm, RETURN)
        self._uc.hook_del(hook)
        result = self._arguments[0] if self._arm else mips_const.UC_MIPS_REG_V0
        return struct.unpack("<i", struct.pack("<I", self._uc.reg_read(result) & 0xFFFFFFFF))[0], count


def linked(
    target: str, sources: Path, folder: Path, beside: Iterable[Path]
) -> tuple[list[tuple[int, bytes]], dict[str, int]]:
    """The program's pieces with their addresses, and where its functions are."""
    made = subprocess.run(["make", "-s", f"target-{target}"], cwd=sources, check=False, capture_output=True, text=True)
    if made.returncode:
        sys.exit(made.stderr or made.stdout)
    said = ["make", "-s", f"--eval=flags: ; @echo $({target}-flags)", "flags"]
    flags = subprocess.run(said, cwd=sources, check=True, capture_output=True, text=True).stdout.split()
    objects = [sources / "build" / target / f"{name}.o" for name in SOURCES]
    gcc, memory, program = f"{PREFIX[target]}gcc", folder / "memory.c", folder / "program"
    memory.write_text(MEMORY)
    whole = ["-Os", "-ffreestanding", "-fno-tree-loop-distribute-patterns", "-nostdlib", "-static"]
    whole += [f"-Wl,-N,-Ttext={CODE:#x}", "-Wl,-e0,--build-id=none,--no-warnings"]
    words = [gcc, *flags, *whole, memory, *beside, *objects, "-lgcc", "-o", program]
    subprocess.run(words, check=True, capture_output=True)
    said = [f"{PREFIX[target]}nm", program]
    names = subprocess.run(said, check=True, capture_output=True, text=True).stdout
    symbols = {line.split()[-1]: int(line.split()[0], 16) for line in names.splitlines()}
    elf = program.read_bytes()
    (table,) = struct.unpack_from("<I", elf, 28)
    size, count = struct.unpack_from("<HH", elf, 42)
    parts = [struct.unpack_from("<7I", elf, table + n * size) for n in range(count)]
    # What is loaded and can be run, constants with it.
    loaded = [each for each in parts if each[0] == each[6] & 1 == 1]
    pieces = [(at, elf[offset : offset + length]) for _, offset, at, _, length, _, _ in loaded]
    return pieces, symbols


def counted(target: str, sources: Path) -> dict[str, Any]:
    """All counts on one target."""
    machine = Machine(target, sources)
    key, message, out = (
        machine.keep(bytes(range(20))),
        machine.keep(bytes(n % 256 for n in range(4096))),
        machine.keep(bytes(64)),
    )
    expanded = machine.keep(bytes(512))
    told: dict[str, Any] = {"expand": machine.call("phx_mac_expand", expanded, key)[1]}
    told["mac"] = {str(n): machine.call("phx_mac", expanded, message, n, out)[1] for n in MAC_BYTES}
    told["hash"] = {str(n): machine.call("phx_sha1", message, n, out)[1] for n in HASH_BYTES}
    told["calls"] = calls(machine)
    return told


def calls(machine: Machine) -> dict[str, int]:
    """The most that each call takes; of what is chained, over a whole batch, at whose end the hash is."""
    limits = struct.pack("<12I", 3, 10_000, 10, 14, 571, 10**6, 10**6, 10**6, 10**6, 1, 1, 1)
    master, blind, salt, out = (machine.keep(bytes([n] * 32)) for n in range(4))
    sealed = b"\x10" + machine.read(blind, 20) + machine.read(salt, 20) + struct.pack("<I", 1)
    machine.call("phx_lightmac", master, sealed, len(sealed), out)
    robots = []
    for robot in (1, 2):
        nodes = {"snode": machine.keep(bytes(1024)), "anode": machine.keep(bytes(2048))}
        for name, node in nodes.items():
            calls_made = [
                machine.call(f"phx_{name}_make", node, limits),
                machine.call(f"phx_{name}_load_master", node, master, robot),
                machine.call(f"phx_{name}_load_mission", node, 0, blind, salt, 1, out),
            ]
            assert not any(code for code, _ in calls_made), "a node without a key"
        robots.append(nodes)
    (snode, anode), (other_s, other_a) = (robot.values() for robot in robots)
    now, entry, mac, audit = 1000, machine.keep(bytes(2100)), machine.keep(bytes(8)), bytes([0x80]) + bytes(1999)

    def most(name: str, *arguments: int | bytes) -> int:
        made = [machine.call(name, *arguments) for _ in range(20)]
        assert all(code >= 0 for code, _ in made), f"{name} was refused"
        return max(count for _, count in made)

    told = {
        "pollSensors": most("phx_snode_poll", snode, now, bytes(27), 27, entry),
        "sendWireless, 27 B": most("phx_anode_send", anode, now, bytes(27), 27, entry),
        "sendWireless, audit of 2000 B": most("phx_anode_send", anode, now, audit, 2000, entry),
        "recvWireless, 27 B": most("phx_anode_recv", anode, now, bytes(27), 27, entry),
        "recvWireless, audit of 2000 B": most("phx_anode_recv", anode, now, audit, 2000, entry),
        "actuatorCmd": most("phx_anode_actuate", anode, now, bytes(19), 19, entry),
    }
    request, authenticator, hckpt = machine.keep(bytes(32)), machine.keep(bytes(32)), bytes(range(20))

    def one(name: str, *arguments: int | bytes) -> int:
        code, count = machine.call(name, *arguments)
        assert code >= 0, f"{name}: {code}"
        return count

    # With a batch that waits to be flushed.
    machine.call("phx_anode_send", other_a, now, bytes(27), 27, entry)
    machine.call("phx_snode_poll", other_s, now, bytes(27), 27, entry)
    told["makeTokenRequest"] = one("phx_anode_token_request", other_a, now, 1, request)
    nonce = request + 24
    told["makeAuthenticator"] = one("phx_snode_make_auth", other_s, nonce, authenticator)
    told["checkAuthenticator"] = one("phx_snode_check_auth", snode, authenticator, 2, nonce, authenticator + 22)
    told["issueToken"] = one("phx_anode_issue_token", anode, 2, now, request + 4, nonce, hckpt, mac)
    told["isTokenValid"] = one("phx_anode_check_token", other_a, 1, 2, now, hckpt, mac)
    told["installToken"] = one("phx_anode_install_token", other_a, now, 1, now, hckpt, mac)
    told["loadMissionKey"] = told_once(machine, limits, master, blind, salt, out)
    return told | on_sealed_radio(machine, other_a, anode)


def on_sealed_radio(machine: Machine, sender: int, hearer: int) -> dict[str, int]:
    """The same of a sealed radio, whose table of senders is as long as it may be to the one who is heard."""
    entry, ours, table, told = machine.keep(bytes(2100)), machine.keep(bytes(2048)), machine.keep(bytes(2048)), {}
    # As many places as there are are taken but the last; src is the last field of each 24 bytes.
    others = b"".join(bytes(20) + struct.pack("<HH", 100 + n, 0) for n in range(63))
    machine.write(table, others)
    for words, frame, at, times in (("27 B", bytes(27), 2000, 20), ("audit of 2000 B", b"\x80" + bytes(1999), 3000, 5)):
        most = {"sendSealed": 0, "recvSealed": 0}
        for now in range(at, at + times):
            code, sent = machine.call("phx_sealed_send", ours, sender, now, frame, len(frame), entry)
            said = machine.read(entry + 7, code - 7)
            taken, heard = machine.call("phx_sealed_recv", table, hearer, now, said, len(said), entry)
            assert min(code, taken) > 0, f"a sealed frame was refused: {code}, {taken}"
            most = {"sendSealed": max(most["sendSealed"], sent), "recvSealed": max(most["recvSealed"], heard)}
        told |= {f"{name}, {words}": count for name, count in most.items()}
    return told


def told_once(machine: Machine, limits: bytes, master: int, blind: int, salt: int, sealed: int) -> int:
    """What loading a mission key takes, both its halves expanded."""
    node = machine.keep(bytes(2048))
    machine.call("phx_anode_make", node, limits)
    machine.call("phx_anode_load_master", node, master, 3)
    return machine.call("phx_anode_load_mission", node, 0, blind, salt, 1, sealed)[1]


def order_check(sources: Path) -> int:
    """What a c-node on a Cortex-M3 would take to look at an order's signature (Monocypher, -Os)."""
    machine = Machine("cortex-m3", sources, sorted((sources / "port" / "monocypher").glob("*.c")))
    # RFC 8032, section 7.1, test 2.
    key = bytes.fromhex("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c")
    signature = bytes.fromhex(
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
        "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00"
    )
    found, count = machine.call("crypto_ed25519_check", signature, key, b"\x72", 1)
    assert found == 0, "a true signature was refused"
    return count


def main() -> int:
    """Count, print, and write if that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sources", type=Path, default=HERE, help="a firmware folder: of another version, to compare")
    parser.add_argument("--write", action="store_true")
    said = parser.parse_args()
    told = {target: counted(target, said.sources) for target in PREFIX}
    told["cortex-m3"]["order"] = order_check(said.sources)
    text = json.dumps(told, indent=2)
    if said.write:
        COUNTS.write_text(text + "\n")
    sys.stdout.write(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
