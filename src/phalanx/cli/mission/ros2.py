"""`phalanx mission ros2`: run an encoded mission on a ROS 2 robot."""

from __future__ import annotations

import contextlib
import math
import time
from pathlib import Path
from typing import Any

import click

from phalanx.cli.credentials import read_trusted
from phalanx.cli.run import needs_ros2
from phalanx.cli.run import run as run_until_stopped
from phalanx.cli.terminal import print_json
from phalanx.config.lidar import ExtractionConfig
from phalanx.mission import admit, check_signature

from .files import doors_of, read_encoded, start_key_of
from .run import parse_start


def ros2(
    file: Path,
    ros: tuple[str, ...],
    start_text: str,
    robot: int,
    doors: str | None,
    namespace: str,
    key: Path | None,
    trust: tuple[str, ...],
    as_json: bool,
) -> int:
    """Run a mission until it is completed or no attempt is left. Return 1 if it was not completed."""
    with needs_ros2():
        from phalanx.bridges.ros2.geometry import Place  # noqa: PLC0415 - an extra
        from phalanx.bridges.ros2.walk import Errand, RosWalk  # noqa: PLC0415
    encoded = read_encoded(file)
    if trust or encoded.signer:
        check_signature(encoded, [read_trusted(each) for each in trust] or None)
    begin_s = time.time()
    admit(encoded, robot, begin_s, ())
    x_m, y_m, yaw_rad = parse_start(start_text)
    errand = Errand(
        mission=encoded,
        key=start_key_of(file, encoded, key, "--key"),
        robot=robot,
        start=Place(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad),
        begin_s=begin_s,
        extraction=doors_of(doors) if doors else ExtractionConfig(),
    )
    with contextlib.closing(RosWalk(errand, namespace, ros, _print_line)) as walk:
        run_until_stopped(walk.live())
    outcome = walk.lived
    summary: dict[str, Any] = {
        "completed": outcome.done,
        "t_s": round(outcome.t_s, 3),
        "nodes": len(encoded.nodes),
        "decoded": [{"t_s": round(t_s, 3), "node": node, "name": name} for t_s, node, name in outcome.decoded],
        "not_validated": [{"t_s": round(t_s, 3), "reason": why} for t_s, why in outcome.not_validated],
        "actions": [{"t_s": round(t_s, 3), "action": name} for t_s, name in outcome.actions],
        "pose": outcome.pose and [outcome.pose.x_m, outcome.pose.y_m, math.degrees(outcome.pose.yaw_rad)],
    }
    if as_json:
        print_json(summary)
    else:
        word = "completed" if outcome.done else "not completed"
        click.echo(f"{word}   {len(outcome.decoded)} of {len(encoded.nodes)} nodes decoded   {outcome.t_s:.0f} s")
    return 0 if outcome.done else 1


def _print_line(t_s: float, words: str) -> None:
    click.echo(f"{t_s:>7.1f} s   {words}", err=True)
