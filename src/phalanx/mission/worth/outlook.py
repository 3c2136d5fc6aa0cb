"""What is to be expected of a mission, before anybody drives."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.mission.graph import Mission


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is to be expected of a mission; nodes by name, each with the reasons."""

    infeasible: dict[str, tuple[str, ...]]  # cannot be decoded: one reason for each way there
    doubtful: dict[str, str]  # may be looked for in the wrong place
    order: tuple[
        str, ...
    ] = ()  # the others, as a robot finds them: first what needs no other to be known, the nearest first

    def completes(self, mission: Mission) -> bool:
        """Whether each part can be lived to its end: to a final node, or to all of them."""
        for part in mission.parts:
            names = {node.name for node in mission.nodes if node.part == part}
            finals = {node.name for node in mission.nodes if node.part == part and node.final}
            if finals <= self.infeasible.keys() if finals else names & self.infeasible.keys():
                return False
        return True
