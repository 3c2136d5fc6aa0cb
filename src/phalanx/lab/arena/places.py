"""Create an arena's files for its robots: keys, a settings file each, and the sockets of the bodies."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from dataclasses import dataclass, field
from pathlib import Path

from phalanx.daemon.driver import sense_path, wheels_path
from phalanx.daemon.on_air import RadioAttack
from phalanx.daemon.settings import RobotSettings, read_robot
from phalanx.daemon.signed_mission import sign_mission
from phalanx.errors import Unavailable
from phalanx.net.keyring import Keys, pem
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.net.ports import LOOPBACK
from phalanx.net.private_file import write_private
from phalanx.scenarios.behaviour import MakeController
from phalanx.scenarios.file import written_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import BOARD

STATION = {"gateway": "orders", "operator": "stops"}  # role: key that it signs with


@dataclass(frozen=True, slots=True, kw_only=True)
class Changes:
    """Replacements for the mission's controller, planner and attacks, and the form of the robots' packets.

    `controller` and `planner` are names as in a robot's file, `attacks` as on the command line; "" keeps the mission's.
    """

    make: MakeController | None
    controller: str
    planner: str
    attacks: tuple[str, ...]
    sealed: bool
    on_air: tuple[RadioAttack, ...]


@dataclass(slots=True)
class Places:
    """Robots' settings and the sockets of their bodies, in order of robot id."""

    robots: list[RobotSettings] = field(default_factory=list)
    sensors: list[socket.socket] = field(default_factory=list)
    wheels: list[socket.socket] = field(default_factory=list)

    def close(self) -> None:
        """Close the sockets."""
        for each in (*self.sensors, *self.wheels):
            each.close()


def write_arena_files(
    scenario: Scenario,
    folder: Path,
    air_port: int,
    ports: list[int],
    clocks: list[tuple[int, int]],
    keys: Keys,
    changes: Changes,
    speed: float,
) -> Places:
    """Write keys and settings of robots, and of a gateway if it has a port; open sockets. Raises: Unavailable."""
    today, air = time.strftime("%Y-%m-%d"), f"{LOOPBACK}:{air_port}"
    places = Places()
    write_private(folder / "mission.yaml", json.dumps(written_scenario(scenario), indent=1).encode())
    ids = range(1, scenario.robots + 1)
    for rob_id in ids:
        board = BOARD.encode(id=rob_id, master=keys.provision(rob_id, today))
        write_private(folder / f"board-{rob_id}.bin", board)
        places.sensors.append(_listen(sense_path(folder, rob_id)))
        places.wheels.append(_listen(wheels_path(folder, rob_id)))
    with_station = len(ports) > scenario.robots
    gateway_id = scenario.robots + 1
    if with_station:
        write_private(folder / "gateway.bin", BOARD.encode(id=gateway_id, master=keys.provision(gateway_id, today)))
    for name in ("key.json", "foreign-key.json"):
        number, sealed = keys.issue()
        signed = sign_mission(scenario, number, keys.signer("missions"))
        write_private(folder / name, encode_mission_key_file(number, sealed, {}, signed.as_json))
    strangers = {each.robot for each in changes.on_air if each.name == "foreign-key"}
    packets = "sealed" if changes.sealed else "plain"
    for rob_id, port, (ppm, ahead_ms) in zip(ids, ports, clocks, strict=False):
        settings = {
            "robot": rob_id,
            "mission": "mission.yaml",
            "key": "foreign-key.json" if rob_id in strangers else "key.json",
            "board": f"board-{rob_id}.bin",
            "trusted": f"process:trusted-{rob_id}.flash",
            "wheels": wheels_path(Path(), rob_id).name,
            "clock_ppm": ppm,
            "clock_ahead_ms": ahead_ms,
            "driver": "arena:.",
            "radio": {"here": f"{LOOPBACK}:{port}", "peers": [air], "packets": packets},
            "controller": changes.controller,
            "planner": changes.planner,
            "clock_speed": speed,
        }
        path = folder / f"robot-{rob_id}.yaml"
        write_private(path, json.dumps(settings, indent=1).encode())
        places.robots.append(read_robot(path))
    if with_station:
        here, at = f"{LOOPBACK}:{ports[-1]}", [{"robot": rob_id, "at": air} for rob_id in ids]
        nodes = {"trusted": "process:gateway.flash", "number": gateway_id, "board": "gateway.bin", "packets": packets}
        settings = {"mission": "mission.yaml", "key": "key.json", "here": here, "robots": at, **nodes}
        for role, key_name in STATION.items():
            write_private(folder / f"{role}.pem", pem(keys.signer(key_name)))
            settings[role] = f"{role}.pem"
        write_private(folder / "swarm.yaml", json.dumps(settings, indent=1).encode())
    return places


def _listen(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        listener.bind(str(path))
    except OSError as error:
        listener.close()
        why = error.strerror or error
        raise Unavailable(f"cannot listen at {path}: {why}", "use a folder with a shorter path") from error
    listener.listen(4)
    listener.setblocking(False)
    return listener


def free_ports(n: int) -> list[int]:
    """Return that many UDP ports that are free on this machine at present."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(n)]
        for each in sockets:
            each.bind((LOOPBACK, 0))
        return [int(each.getsockname()[1]) for each in sockets]
