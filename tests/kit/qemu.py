"""Boards in QEMU: the firmware's images without an operating system, and their emulated UARTs."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import time
from pathlib import Path

import boards
from phalanx.net.children import die_with_parent
from phalanx.net.serial_line import open_line
from phalanx.net.serial_node import SerialNode

# A processor of each kind that the nodes are compiled for (firmware/targets.mk).
MACHINES = {
    "mps2-an385": ["qemu-system-arm", "-M", "mps2-an385"],  # Cortex-M3
    "mps2-an505": ["qemu-system-arm", "-M", "mps2-an505"],  # Cortex-M33
    "microbit": ["qemu-system-arm", "-M", "microbit"],  # Cortex-M0
    "malta": ["qemu-system-mipsel", "-M", "malta", "-cpu", "24KEc", "-nic", "none", "-vga", "none"],  # MIPS32
}


class Emulated:
    """A machine that runs an image; its first UART is a line."""

    def __init__(self, folder: Path, machine: str, image: str) -> None:
        folder.mkdir(exist_ok=True)
        # A socket's path may have a hundred bytes: QEMU is told it from its folder.
        words = [
            "-kernel",
            str(boards.built(f"{image}.elf")),
            "-display",
            "none",
            "-serial",
            "unix:uart,server=on,wait=off",
        ]
        self._process = subprocess.Popen(
            [*MACHINES[machine], *words, "-monitor", "unix:monitor,server=on,wait=off"],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            preexec_fn=die_with_parent,
        )
        self._folder = folder
        end_s = time.monotonic() + 300  # a busy machine takes its time to begin
        while not (folder / "uart").exists() and time.monotonic() < end_s:
            time.sleep(0.02)
        self._line = open_line(f"unix:{folder / 'uart'}")

    def board(self, **said) -> SerialNode:
        """A handshake with what runs."""
        return SerialNode(self._line, **(boards.PATIENT | {"timeout_s": 300.0, "again_s": 30.0} | said))

    def reset(self) -> None:
        """Power-up: the processor begins anew."""
        with socket.socket(socket.AF_UNIX) as monitor:
            monitor.connect(str(self._folder / "monitor"))
            monitor.sendall(b"system_reset\n")
            monitor.settimeout(60)
            told = b""
            while told.count(b"(qemu)") < 2:  # before it and behind it
                told += monitor.recv(1000)

    def again(self) -> SerialNode:
        """Power-up and a handshake."""
        self.reset()
        return self.board()

    def close(self) -> None:
        """It is gone."""
        self._line.close()
        self._process.kill()
        self._process.wait()


@contextlib.contextmanager
def machines(folder: Path, machine: str, n: int, image: str | None = None):
    """So many machines of a kind; without an image's name they are benches."""
    with contextlib.ExitStack() as stack:
        made = []
        for i in range(n):
            made.append(Emulated(folder / str(i), machine, image or f"{machine}-bench"))
            stack.callback(made[-1].close)
        yield made
