"""Load a user's controller, planner or attack from "FILE.py:CLASS", or kernels from "FILE.py".

The file runs as a script, so name only files that you trust.
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import sys
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import phalanx.robot
from phalanx.config.written import read_at_most
from phalanx.errors import OwnFileError, PhalanxError, UsageError, did_you_mean
from phalanx.robot.adversary.attack import Attack, own_attack
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers import dispatch, own_kernels
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.python_controller import Controller, OwnMistake
from phalanx.robot.planner import MakePlanner, Planner

from .attack_spec import AttackSpec, parse_attack
from .behaviour import params_of
from .scenario import CONTROLLERS, Scenario, in_scenarios

TRACEBACK_HINT = "phalanx --log-level debug shows the whole traceback"
# Exceptions not blamed on a user's file if none of its lines is in the traceback.
OURS = (AssertionError, OSError, MemoryError, SystemExit)
MOST_BYTES = 1 << 24  # of a user's file
logger = logging.getLogger(__name__)


def find_controller(
    words: str | None, scenario: Scenario, *, in_python: bool = False
) -> tuple[Scenario, Callable[[int], Controller] | None]:
    """Return the scenario and a factory of its controllers: None for a bundled one, or one from a file with kernels.

    Args:
        words: "FILE.py:CLASS", "FILE.py" with kernels, the name of a bundled controller, or None for the scenario's.
        in_python: return a factory for a file with kernels too, and the scenario unchanged.
    Raises: UsageError: no such controller; other errors as in `find_class`.
    """
    if words is None:
        return scenario, None
    if is_file(words):
        made = find_own(words)
        if made:
            return scenario, made
        chosen = replace(scenario, controller=words)
        return (scenario, compiled(dispatch.NUMBERS[words], params_of(chosen))) if in_python else (chosen, None)
    if words not in CONTROLLERS:
        raise no_controller(words, in_scenarios())
    return replace(scenario, controller=words), None


def find_own(words: str) -> Callable[[int], Controller] | None:
    """Return the factory of controllers in a file's class; for a file with kernels, register them and return None."""
    path, _, name = words.partition(":")
    if not name and own_kernels.is_loaded(words, Path(path)):
        return None
    module = _run(Path(path))
    if name or not isinstance(getattr(module, "CONTROLLER", None), Declaration):
        made: Callable[[int], Controller] = _class_in(module, Path(path), name, Controller)
        return made
    with mistakes_in(words):
        own_kernels.load_kernels(words, module)
    return None


def find_planner(words: MakePlanner | str | None) -> MakePlanner | None:
    """Return the planner class in "FILE.py:CLASS"; a planner class or None is returned unchanged.

    Raises: UsageError: not a file; other errors as in `find_class`.
    """
    if not isinstance(words, str):
        return words
    if not is_file(words):
        raise UsageError(f"no planner {words!r}", "use FILE.py:CLASS, a class derived from phalanx.robot.Planner")
    made: MakePlanner = find_class(words, Planner)
    return made


def no_controller(words: str, known: Collection[str]) -> UsageError:
    """Return the error for a name that is neither a `known` controller nor a file."""
    hint = f"{did_you_mean(words, known)}use {', '.join(known)}, or FILE.py:CLASS"
    return UsageError(f"no controller {words!r}", hint)


def find_attacks(said: Sequence[str | AttackSpec | Attack | type[Any]]) -> tuple[AttackSpec, ...]:
    """Return the attacks found by `find_attack` for each item; () for "none".

    Raises: UsageError: "none" together with an attack.
    """
    if list(said) == ["none"]:
        return ()
    if "none" in said:
        raise UsageError("an attack together with none", "use one or the other")
    return tuple(map(find_attack, said))


def find_attack(said: str | AttackSpec | Attack | type[Any]) -> AttackSpec:
    """Return the attack for `NAME[:robot=I,at=T,until=T,OPTION=VALUE,…]`; NAME may be FILE.py:CLASS, times are in s."""
    if isinstance(said, AttackSpec):
        return said
    if not isinstance(said, str):
        own = own_attack(said)
        return AttackSpec(name=own.name, own=own)
    if not is_file(said):
        return parse_attack(said)
    path, _, rest = said.partition(":")
    name, colon, options = ("", "", rest) if "=" in rest.partition(":")[0] else rest.partition(":")
    own = own_attack(find_class(f"{path}:{name}", Liar))
    return parse_attack(own.name + (f":{options}" if colon or options else ""), own)


def find_class(words: str, kind: type[Any]) -> Any:
    """Return the class in "FILE.py:CLASS", or for "FILE.py" the only class derived from `kind`.

    CLASS may also name a function that makes a controller for a robot's id, or the `Attack` record of an attack.
    Raises: UsageError: no such file or class, or the file raises. Unavailable: the file cannot be read.
    """
    path, _, name = words.partition(":")
    return _class_in(_run(Path(path)), Path(path), name, kind)


def _class_in(module: ModuleType, path: Path, name: str, kind: type[Any]) -> Any:
    own = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, kind) and value.__module__ == module.__name__
    }
    if not name:
        if len(own) != 1:
            raise UsageError(f"{path} has {len(own)} classes derived from {kind.__name__}", f"use {path}:CLASS")
        name = next(iter(own))
    found = getattr(module, name, None)
    base = f"{'phalanx.robot' if kind.__name__ in phalanx.robot.__all__ else kind.__module__}.{kind.__name__}"
    if found is None:
        known = f"it has {', '.join(own)}" if own else f"derive one from {base}"
        raise UsageError(f"{path} has no {name}", did_you_mean(name, own) + known)
    if not issubclass(found if isinstance(found, type) else kind, kind):
        raise UsageError(f"{name} in {path} is not a {kind.__name__}", f"derive it from {base}")
    if not callable(found) and not (kind is Liar and isinstance(found, Attack)):
        raise UsageError(f"{name} in {path} is a {type(found).__name__}", f"use a class derived from {kind.__name__}")
    if left := sorted(getattr(found, "__abstractmethods__", ())):
        raise UsageError(f"{name} in {path} has no {', '.join(left)}", f"define it, as described in {kind.__name__}")
    for number in ("state_bytes", "reading_bytes", "period_ms"):
        value = getattr(found, number, 0)
        if not isinstance(value, int) or value < 0:
            raise UsageError(f"{number} of {name} in {path} is {value!r}", "use a whole number, 0 or more")
    return found


@contextlib.contextmanager
def mistakes_in(*named: str | None) -> Iterator[None]:
    """Turn exceptions raised in these files, or in files beside them, into a `UsageError` with file and line.

    The traceback is logged at DEBUG. An exception that no line of the files took part in is passed on unchanged.

    Args:
        named: "FILE.py:CLASS" or "FILE.py"; others, and None, are ignored.
    """
    files = [words.partition(":")[0] for words in named if words and is_file(words)]
    try:
        yield
    except OwnMistake as error:
        where = _first_shown([*_raised_at(error), *error.places], files)
        if not where and len(files) != 1:
            raise
        # An object of another module was made, or is held, by an object of that file.
        raise OwnFileError(f"{where or files[0]}: {error}", error.hint) from error
    except OwnFileError:
        raise
    except UsageError as error:
        where = _first_shown(_raised_at(error), files)
        if not where:
            raise
        logger.debug("%s", where, exc_info=error)
        raise UsageError(f"{where}: {error}", error.hint or TRACEBACK_HINT) from error
    except (PhalanxError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as error:
        places = _raised_at(error)
        if isinstance(error, SyntaxError) and error.filename:
            places.insert(0, (error.filename, error.lineno))
        where = _first_shown(places, files) or ("" if isinstance(error, OURS) else " or ".join(files))
        if not where:
            raise
        logger.debug("%s", where, exc_info=error)
        text = error.msg if isinstance(error, SyntaxError) else str(error)
        message = f"{where}: {type(error).__name__}" + (f": {text}" if text else "")
        raise UsageError(message.splitlines()[0], TRACEBACK_HINT) from error


def _raised_at(error: BaseException) -> list[tuple[str, int | None]]:
    """Return file and line of each call in the error's traceback, innermost first."""
    return [(frame.filename, frame.lineno) for frame in reversed(traceback.extract_tb(error.__traceback__))]


def _first_shown(places: Iterable[tuple[str, int | None]], files: Sequence[str]) -> str:
    """Return the first place in these files or their folders as "FILE.py:LINE", with the user's path; "" if none."""
    for name, line in places:
        path = Path(name).resolve()
        for file in files:
            if path == Path(file).resolve():
                return f"{file}:{line}"
            if path.parent == Path(file).resolve().parent and path.is_file():  # skips "<string>"
                return f"{Path(file).with_name(path.name)}:{line}"
    return ""


def is_file(words: str) -> bool:
    """Return True if a controller or an attack is given as "FILE.py" or "FILE.py:CLASS"."""
    return words.partition(":")[0].endswith(".py")


def _run(path: Path) -> ModuleType:
    """Run a user's file and return its module."""
    read_at_most(path, MOST_BYTES, "FILE.py:CLASS")
    name = f"phalanx_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up there
    beside = str(path.resolve().parent)
    sys.path.insert(0, beside)  # for imports from its own folder, as in a script
    try:
        with mistakes_in(str(path)):
            # Not with the loader, which may run stale bytecode of a file that changed twice within a second.
            exec(compile(path.read_bytes(), str(path), "exec"), vars(module))  # noqa: S102 - the user trusts the file
    finally:
        sys.path.remove(beside)
    return module
