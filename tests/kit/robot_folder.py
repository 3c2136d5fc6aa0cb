"""The folder of a robot's process: its board's file, a mission and its key, and robot.yaml."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from phalanx.net.keyring import Keys
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.wire.table import BOARD
from ports import free_udp_port


def write_robot(folder: Path, rob_id: int, mission: str, **more: Any) -> tuple[Keys, dict[str, Any]]:
    """Write these files; return the keys of the mission's owner, and what robot.yaml says."""
    keys = Keys.new("test")
    (folder / "board.bin").write_bytes(BOARD.encode(id=rob_id, master=keys.provision(rob_id, "2026-01-01")))
    (folder / "key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))
    (folder / "mission.yaml").write_text(mission)
    radio = {"here": f"127.0.0.1:{free_udp_port()}", "peers": ["127.0.0.1:9"]}
    said = {"robot": rob_id, "mission": "mission.yaml", "key": "key.json", "board": "board.bin", "radio": radio} | more
    (folder / "robot.yaml").write_text(json.dumps(said))
    return keys, said
