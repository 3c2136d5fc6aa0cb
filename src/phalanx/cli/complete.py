"""Shell completion of arguments: bundled names and files of the fitting type."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from phalanx.config.builtin import built_in
from phalanx.robot.adversary.registry import attacks, swarm_attacks
from phalanx.scenarios.scenario import CONTROLLERS, in_scenarios

Offer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def offer(names: Callable[[], Iterable[str]], *endings: str) -> Offer:
    """Return a completer that offers `names` and files with one of `endings` (".yaml"), or else any file.

    After FILE.py: it offers the classes in that file. `names` is called only on completion.
    """

    def complete(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
        folder = Path(begun if begun.endswith("/") else Path(begun).parent)
        files = [path for path in folder.glob("*") if path.suffix in endings]
        path, _, name = begun.partition(":")
        if path.endswith(".py") and ".py" in endings and (known := _classes(Path(path))):
            return [CompletionItem(f"{path}:{each}") for each in known if each.startswith(name)]
        words = sorted([*names(), *(f"./{path}" if begun.startswith("./") else str(path) for path in files)])
        fitting = [CompletionItem(word) for word in words if word.startswith(begun)]
        # The shell completes files itself, including subfolders.
        return fitting or ([CompletionItem(begun, type="file")] if endings else [])

    return complete


def _classes(path: Path) -> list[str]:
    """Return the public classes that a Python file defines, or [] if it cannot be parsed. The file is not executed."""
    try:
        parts = ast.parse(path.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return []
    return [part.name for part in parts if isinstance(part, ast.ClassDef) and not part.name.startswith("_")]


a_scenario = offer(lambda: built_in("scenarios"), ".yaml", ".yml")
a_scenario_or_recording = offer(lambda: built_in("scenarios"), ".yaml", ".yml", ".mcap")
a_map = offer(lambda: built_in("maps"), ".yaml", ".yml")
a_mission = offer(lambda: built_in("missions"), ".yaml", ".yml")
a_mission_or_encoded = offer(lambda: built_in("missions"), ".yaml", ".yml", ".phxm")
an_encoded_mission = offer(tuple, ".phxm")
an_attack_by_robots = offer(lambda: ("none", *swarm_attacks()), ".py")
an_attack = offer(attacks, ".py")
a_controller = offer(lambda: CONTROLLERS, ".py")
a_scenario_s_controller = offer(in_scenarios, ".py")
