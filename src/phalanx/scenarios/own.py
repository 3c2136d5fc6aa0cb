"""Load a researcher's own file, "FILE.py:CLASS" or "FILE.py" with kernels.

The file is run as a script: name only files that you trust.
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
# Raised while no line of a researcher's file runs, these are no mistakes of that file.
OURS = (AssertionError, OSError, MemoryError, SystemExit)
MOST_BYTES = 1 << 24  # of a file of one's own
logger = logging.getLogger(__name__)


def find_controller(
    words: str | None, scenario: Scenario, *, in_python: bool = False
) -> tuple[Scenario, Callable[[int], Controller] | None]:
    """Return the scenario, and what makes its controllers: None for a bundled one, or one of a file with kernels.

    Args:
        words: "FILE.py:CLASS", "FILE.py" with kernels, the name of a bundled controller, or None for the scenario's.
        in_python: make controllers of a file with kernels, too, for robots that know the scenario from elsewhere.
    Raises: as `find_class`. UsageError: no such name.
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
    """Return what makes controllers of a file's class; None for a file with kernels, now registered by these words."""
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
    """Return the planner of "FILE.py:CLASS", or a planner or None unchanged.

    Raises: UsageError: as `find_class`, or no file.
    """
    if not isinstance(words, str):
        return words
    if not is_file(words):
        raise UsageError(f"no planner {words!r}", "FILE.py:CLASS, derived from phalanx.robot.Planner")
    made: MakePlanner = find_class(words, Planner)
    return made


def no_controller(words: str, known: Collection[str]) -> UsageError:
    """Return the error for a name that is neither one of the `known` controllers nor a file."""
    return UsageError(f"no controller {words!r}", f"{did_you_mean(words, known)}{', '.join(known)}, or FILE.py:CLASS")


def find_attacks(said: Sequence[str | AttackSpec | Attack | type[Any]]) -> tuple[AttackSpec, ...]:
    """Return the attacks of all of these, as `find_attack`; () of "none". Raises: UsageError: "none" and another."""
    if list(said) == ["none"]:
        return ()
    if "none" in said:
        raise UsageError("an attack and none", "one or the other")
    return tuple(map(find_attack, said))


def find_attack(said: str | AttackSpec | Attack | type[Any]) -> AttackSpec:
    """Return the attack of `NAME[:robot=I,at=T,until=T,OPTION=VALUE,…]`, times in seconds, NAME or FILE.py:CLASS."""
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
    """Return the class of "FILE.py:CLASS"; of "FILE.py" the only one that is derived from `kind`.

    A controller's may also be a function that makes one for a robot's id; an attack's, its record.
    Raises: UsageError: no such file or class, or the file raises. Unavailable: it cannot be read.
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
            raise UsageError(f"{path} has {len(own)} classes derived from {kind.__name__}", f"{path}:CLASS names one")
        name = next(iter(own))
    found = getattr(module, name, None)
    base = f"{'phalanx.robot' if kind.__name__ in phalanx.robot.__all__ else kind.__module__}.{kind.__name__}"
    if found is None:
        known = f"it has {', '.join(own)}" if own else f"derive one from {base}"
        raise UsageError(f"{path} has no {name}", did_you_mean(name, own) + known)
    if not issubclass(found if isinstance(found, type) else kind, kind):
        raise UsageError(f"{name} in {path} is no {kind.__name__}", f"derive it from {base}")
    if not callable(found) and not (kind is Liar and isinstance(found, Attack)):
        raise UsageError(f"{name} in {path} is a {type(found).__name__}", f"a class derived from {kind.__name__}")
    if left := sorted(getattr(found, "__abstractmethods__", ())):
        raise UsageError(f"{name} in {path} has no {', '.join(left)}", f"{kind.__name__} says what they do")
    for number in ("state_bytes", "reading_bytes", "period_ms"):
        value = getattr(found, number, 0)
        if not isinstance(value, int) or value < 0:
            raise UsageError(f"{number} of {name} in {path} is {value!r}", "a whole number, 0 or more")
    return found


@contextlib.contextmanager
def mistakes_in(*named: str | None) -> Iterator[None]:
    """Turn mistakes of the files in these "FILE.py:CLASS", or beside them, into a `UsageError` with file and line.

    The traceback is logged, at DEBUG. A call of ours may fail before a line of a file runs: then none is named.
    """
    files = [words.partition(":")[0] for words in named if words and is_file(words)]
    try:
        yield
    except OwnMistake as error:
        where = _first_shown([*_raised_at(error), *error.places], files)
        if not where and len(files) != 1:
            raise
        # Objects from elsewhere were made, or are held, by an object of that file.
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
        said = error.msg if isinstance(error, SyntaxError) else str(error)
        words = f"{where}: {type(error).__name__}" + (f": {said}" if said else "")
        raise UsageError(words.splitlines()[0], TRACEBACK_HINT) from error


def _raised_at(error: BaseException) -> list[tuple[str, int | None]]:
    """Return file and line of each call that the error came through, the innermost first."""
    return [(frame.filename, frame.lineno) for frame in reversed(traceback.extract_tb(error.__traceback__))]


def _first_shown(places: Iterable[tuple[str, int | None]], files: Sequence[str]) -> str:
    """Return the first place in these files or their folders, "FILE.py:LINE" as the user named them; "" if none is."""
    for name, line in places:
        path = Path(name).resolve()
        for file in files:
            if path == Path(file).resolve():
                return f"{file}:{line}"
            if path.parent == Path(file).resolve().parent and path.is_file():  # and not "<string>"
                return f"{Path(file).with_name(path.name)}:{line}"
    return ""


def is_file(words: str) -> bool:
    """Return whether a controller or an attack is named by its file: "FILE.py:CLASS"."""
    return words.partition(":")[0].endswith(".py")


def _run(path: Path) -> ModuleType:
    read_at_most(path, MOST_BYTES, "FILE.py:CLASS")
    name = f"phalanx_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look there
    beside = str(path.resolve().parent)
    sys.path.insert(0, beside)  # for imports from its own folder, as when it is run
    try:
        with mistakes_in(str(path)):
            # Not by the loader: if a file changed twice in a second, it may run stale bytecode.
            exec(compile(path.read_bytes(), str(path), "exec"), vars(module))  # noqa: S102 - whoever names it trusts it
    finally:
        sys.path.remove(beside)
    return module
