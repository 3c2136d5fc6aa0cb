"""An agent that does what a prompt injection tells it: all that its tools allow, and all that a stolen ticket allows.

`docs/guides/agents.md` lists the refusals that are expected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

ROUTE = {"threshold": 60, "waypoints": [{"x": 500, "y": 500}]}
OPERATORS = "visitors remove everybody_out new_code code room door approve role give take swap invite stop go".split()


@dataclass(frozen=True)
class Attempt:
    """A call of a tool, and what the agent must be told."""

    tool: str
    arguments: dict[str, Any]
    refusal: str  # regular expression


def attempts(own: str, other: str) -> list[Attempt]:
    """Return what is tried with a ticket for the robot `own`."""

    def drive(robot: Any = own, left: Any = 10, right: Any = 10, **more: Any) -> dict[str, Any]:
        return {"robot": robot, "left_percent": left, "right_percent": right} | more

    def route(points: Any, robot: str = own) -> dict[str, Any]:
        return {"robot": robot, "points": points}

    return [
        # another's robot
        Attempt("drive", drive(other), "not allowed"),
        Attempt("drive", drive(other.lower()), "not allowed"),
        Attempt("follow_route", route([[500, 500]], other), "not allowed"),
        Attempt("stop", {"robot": other}, "not allowed"),
        # robots that there are not, and names with markup
        *[
            Attempt(tool, {"robot": name} | more, "no robot is called so|not a robot's address|at least 1|at most 64")
            for tool, more in (
                ("look", {}),
                ("stop", {}),
                ("drive", {"left_percent": 1, "right_percent": 1}),
                ("follow_route", {"points": [[1, 1]]}),
            )
            for name in (
                "<b>x</b>",
                "../" + own,
                own + "\n",
                "\x1b[2J",
                "*",
                "",
                own * 9,
                "\uff21\uff22",
                "'; stop --all",
            )
        ],
        Attempt("stop", {"robot": "FFFF"}, "not allowed"),
        # speeds and times beyond the limits
        *[
            Attempt("drive", drive(left=value), "left_percent")
            for value in (101, -101, 10**9, 0.5, math.nan, math.inf, "fast", None, [], {"x": 1})
        ],
        *[Attempt("drive", drive(seconds=value), "seconds") for value in (0, -1, 10.5, 10**9, math.nan, math.inf, "x")],
        # routes
        Attempt("follow_route", route([]), "points"),
        Attempt("follow_route", route([[1, 1]] * 65), "points"),
        Attempt("follow_route", route([[1, 1]] * 50_000), "points"),
        Attempt("follow_route", route([[math.nan, 1]]), "points"),
        Attempt("follow_route", route([[1]]), "points"),
        Attempt("follow_route", route("home"), "points"),
        Attempt("follow_route", route([[-50_000, 1]]), "refused: bad"),
        Attempt("follow_route", route([[1e9, 1]]), "points"),
        # tools that there are not
        *[Attempt(tool, {"visitor": 1}, "[Uu]nknown tool") for tool in ("operate", *OPERATORS[:3], "request", "eval")],
    ]


def raw_commands(own: str) -> list[tuple[str, bytes, str]]:
    """Return what is tried with a stolen ticket and a program: a command, its payload, and why it is refused."""
    giant = b'{"threshold":60,"waypoints":[' + b",".join([b'{"x":1,"y":1}'] * 65) + b"]}"
    return [
        ("move_raw", b'{"left_y":NaN,"right_y":1}', "bad"),
        ("move_raw", b'{"left_y":1e999,"right_y":1}', "bad"),
        ("move_raw", b'{"left_y":129,"right_y":1}', "bad"),
        ("move_raw", b'{"left_y":1,"left_y":100,"right_y":1}', "bad"),
        ("move_raw", b"[" * 4000, "bad"),
        ("move_raw", b"", "bad"),
        ("waypoints", giant, "too_many"),
        ("waypoints", b'{"threshold":NaN,"waypoints":[]}', "bad"),
        ("waypoints", b'{"threshold":60,"waypoints":[{"x":-1,"y":1}]}', "bad"),
        ("dance", b"{}", "unknown"),
        ("remove", b'{"visitor":1}', "unknown"),
    ]
