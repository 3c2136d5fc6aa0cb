"""What a visitor reads in state updates, and the swarm as it knows it from them alone."""

from __future__ import annotations

import struct
from base64 import urlsafe_b64decode


def read_places(pieces) -> list[tuple[int, int, int, int]]:
    """What a visitor reads: number, x, y (mm) and direction (degrees) of each robot."""
    rows = []
    for number, left, top, step, text in pieces:
        for word, x, y in struct.iter_unpack("<HHH", urlsafe_b64decode(text)):
            skipped, direction = divmod(word, 360)
            number += min(181, skipped)
            if skipped < 181:
                rows.append((number, left + step * x, top + step * y, direction))
                number += 1
    return rows


def read_route(route) -> list[dict[str, int]]:
    """Return the points of `[x, y, step, points]`, as a list tells them."""
    left, top, step, text = route
    points = struct.iter_unpack("<HH", urlsafe_b64decode(text + "=" * (-len(text) % 4)))
    return [{"x": left + step * x, "y": top + step * y, "z": 0} for x, y in points]


class Mirror:
    """What a visitor knows, kept up from frames alone."""

    def __init__(self, robots):
        self.robots = {robot["address"]: dict(robot) for robot in robots}
        self.seq = None

    def read(self, frame):
        assert frame["cmd"] == 16
        data = frame["data"]
        assert self.seq is None or data["seq"] == self.seq + 1
        self.seq = data["seq"]
        for address in data.get("left", ()):
            del self.robots[address]
        for robot in data.get("joined", ()):
            self.robots[robot["address"]] = dict(robot)
        by_number = {robot["n"]: robot for robot in self.robots.values()}
        assert len(by_number) == len(self.robots)
        for number, x, y, direction in read_places(data["places"]) if "places" in data else ():
            by_number[number] |= {"lh2_position": {"x": x, "y": y, "z": 0}, "direction": direction}
        for change in data.get("changed", ()):
            known = self.robots[change["address"]]
            known |= {key: value for key, value in change.items() if key not in ("history_cleared", "battery_mv")}
            if "battery_mv" in change:
                known["battery"] = change["battery_mv"] / 1000
        for number, *route in data.get("routes", ()):
            by_number[number] |= {"waypoints": read_route(route), "mode": int(bool(route[-1]))}
        for number, names in data.get("drivers", ()):
            if number in by_number:  # else it left in this frame
                by_number[number]["drivers"] = names


def are_near(told, route):
    """Return whether a route that was read is the one that a list tells, but for rounding."""
    pairs = zip(told, route, strict=True)
    return all(abs(one[axis] - other[axis]) <= 0.6 for one, other in pairs for axis in "xy")
