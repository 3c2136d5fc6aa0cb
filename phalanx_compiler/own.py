"""A user's own kernels as a shared library: their C, the machine's compiler, and the cache of what it made.

Python's headers are not needed: the library is plain C. Each kernel is exported as `own_NAME`, with its arguments by
value and a `struct fault *`; a violation fills that, and the caller raises it as one of its own (runtime.h).
"""

from __future__ import annotations

import contextlib
import grp
import hashlib
import os
import pwd
import shlex
import shutil
import stat
import string
import subprocess
import sysconfig
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .flags import FLAGS
from .parsing import forget_files, shown_path
from .unit import Unit
from .value_types import signature_of

OPTIONS = (*FLAGS, "-fno-fast-math", "-fPIC", "-shared", "-w", "-x", "c", "-")
COMPILERS = ("cc", "gcc", "clang")
TIMEOUT_S = 120
WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class NoCompiler(Exception):
    """There is no C compiler, or it fails: the message is one line."""


class UnsafeCache(Exception):
    """The cache's folder is not the user's alone: the message is one line."""


@dataclass(frozen=True, slots=True)
class Own:
    """A user's kernel, and the test of what it returns.

    Attributes:
        check: kernel of what is returned, of the parameter number `row` if there is one, and of `numbers`.
        violation: name of the violation if the check fails (violations.py).
    """

    function: Callable[..., Any]
    check: Callable[..., Any] | None = None
    row: int | None = None
    numbers: tuple[int, ...] = ()
    violation: str = ""


class _OwnUnit(Unit):
    """The C of a user's kernels, by name, and of all kernels of the package at `root` that they call."""

    def __init__(self, kernels: Mapping[str, Own], file: str, root: Path) -> None:
        super().__init__()
        self._kernels, self._root, self._file = kernels, root, shown_path(file)
        self.site(self._file, 1)  # the first place is where `caller` begins
        self._heads = {name: self.site(self._file, line_of(own.function)) for name, own in kernels.items()}

    def function(self, function: Callable[..., Any]) -> str:
        """Return a kernel's C name: files may be called what C does not allow."""
        if function not in self.names:
            self.names[function] = f"k{len(self.names)}_{function.__name__}"
            self.waiting.append(function)
        return self.names[function]

    def marks_call(self, by: Callable[..., Any], called: Callable[..., Any]) -> bool:
        """Return whether a kernel of the user's calls one of the package."""
        return self._is_own(by.__code__.co_filename) and not self._is_own(called.__code__.co_filename)

    def _is_own(self, file: str) -> bool:
        return not Path(file).resolve().is_relative_to(self._root)

    def _places(self) -> str:
        """Write the lines of the user's files; those of the package have no file, and name the caller."""
        own = {file: self._is_own(file) for file, _ in self.sites}
        return "\n".join(f"    {{{_c_text(file) if own[file] else '0'}, {line}}}," for file, line in self.sites)

    def _interface(self, _entries: list[Callable[..., Any]]) -> list[str]:
        hand_over = """\
static void hand_over(struct frame *frame, struct fault *fault)
{
    const site *place = frame->fault.file != NULL ? NULL : site_of(caller);
    *fault = frame->fault;
    if (place != NULL) { fault->file = place->file; fault->line = place->line; }
    fault->what |= IN_OWN;
    leave(frame);
}
__attribute__((visibility("default"))) void **own_linked(void) { return linked; }"""
        return [hand_over, *(self._exported(name, own) for name, own in self._kernels.items())]

    def _exported(self, name: str, own: Own) -> str:
        parameters, returned = signature_of(own.function)
        types = list(parameters.values())
        head = ", ".join([*(f"{self.c_type(typ)} a{k}" for k, typ in enumerate(types)), "struct fault *fault"])
        call = f"{self.function(own.function)}({', '.join(f'a{k}' for k in range(len(types)))})"
        lines = [
            f'__attribute__((visibility("default"))) {self.c_type(returned)} own_{name}({head})',
            "{",
            "    struct frame frame;",
            "    enter(&frame);",
            "    if (setjmp(frame.jump) != 0) {",
            "        hand_over(&frame, fault);",
            "        return 0;",
            "    }",
            f"    {self.c_type(returned)} returned = {call};",
        ]
        if own.check:
            given = ["returned", *([f"a{own.row}"] if own.row is not None else []), *map(str, own.numbers)]
            is_right = f"{self.function(own.check)}({', '.join(given)})"
            size = "0" if own.row is None else f"a{own.row}.n0"
            violation = f"violate({self._heads[name]}, {own.violation}, returned, {size})"
            lines.append(f"    if (UNLIKELY(!{is_right})) {violation};")
        return "\n".join([*lines, "    leave(&frame);", "    return returned;", "}"])


def _c_text(text: str) -> str:
    """Return a C string of any text."""
    raw = text.encode("utf-8", "replace")
    plain = b"/._- " + string.ascii_letters.encode() + string.digits.encode()
    return '"' + "".join(chr(each) if each in plain else f"\\{each:03o}" for each in raw) + '"'


def line_of(function: Callable[..., Any]) -> int:
    """Return the line on which a kernel begins: that of its first decorator."""
    return function.__code__.co_firstlineno


def source_of_own(kernels: Mapping[str, Own], file: str, root: Path) -> tuple[str, dict[str, int]]:
    """Return the C of a user's file, and the slots of the trusted nodes' functions that it needs.

    Args:
        root: folder of the package.
    Raises: SubsetError: a kernel is outside the subset.
    """
    forget_files()
    unit = _OwnUnit(kernels, file, root)
    checks = [own.check for own in kernels.values() if own.check]
    # The functions behind checks are written as all that is called.
    text = unit.text([*(own.function for own in kernels.values()), *checks])
    return text, unit.slots


# --- the machine's compiler, and the cache ---


def cache_folder() -> Path:
    """Return the folder of compiled controllers, and create it and its parents for the user alone.

    Raises: UnsafeCache: others own it or can write to it, or to a folder above it. OSError: it cannot be created.
    """
    base = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "phalanx" / "controllers"
    for each in (*reversed(folder.parents), folder):
        with contextlib.suppress(FileExistsError):
            each.mkdir(mode=0o700)
    # Whoever can rename a folder on the way can put one of their own in its place.
    for each in {*folder.parent.parents, *folder.parent.resolve().parents}:
        about = each.stat()
        if about.st_uid not in (0, os.geteuid()):
            raise UnsafeCache(f"{each} belongs to user {about.st_uid}")
        if _others_can_write(about) and not about.st_mode & stat.S_ISVTX:
            raise UnsafeCache(f"others can write to {each}")
    for each in (folder.parent, folder):
        about = each.lstat()
        if not stat.S_ISDIR(about.st_mode):
            raise UnsafeCache(f"{each} is a link")
        if about.st_uid != os.geteuid():
            raise UnsafeCache(f"{each} belongs to user {about.st_uid}")
        if about.st_mode & WRITABLE_BY_OTHERS:
            raise UnsafeCache(f"others can write to {each}")
    return folder


def _others_can_write(about: os.stat_result) -> bool:
    """Return whether a folder's mode lets others write; a group that only holds its user is none."""
    if about.st_mode & stat.S_IWGRP:
        try:
            user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(about.st_gid)
        except KeyError:
            return True
        if group.gr_name != user.pw_name or set(group.gr_mem) - {user.pw_name}:
            return True
    return bool(about.st_mode & stat.S_IWOTH)


def library_of(text: str, version: str) -> Path:
    """Return the shared library of a C text: from the cache, or compiled.

    Without a compiler, what any compiler has made of the same text is taken.

    Args:
        version: of the package.
    Raises: NoCompiler, UnsafeCache, OSError.
    """
    folder = cache_folder()
    inputs = "\0".join([version, sysconfig.get_platform(), *OPTIONS, text])
    key = hashlib.sha256(inputs.encode()).hexdigest()[:32]
    try:
        compiler = find_compiler()
        made_by = hashlib.sha256("\0".join([*compiler, _version_of(compiler)]).encode()).hexdigest()[:16]
    except NoCompiler:
        found = next((each for each in sorted(folder.glob(f"{key}-*.so")) if _is_ours(each)), None)
        if found is None:
            raise
        return found
    library = folder / f"{key}-{made_by}.so"
    if not _is_ours(library):
        _compile(compiler, text, library)
    return library


def find_compiler() -> list[str]:
    """Return the command of the machine's C compiler: CC, or the first of `COMPILERS`. Raises: NoCompiler: none."""
    try:
        chosen = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompiler(f"CC: {error}") from error
    for words in [chosen] if chosen else [[each] for each in COMPILERS]:
        if found := shutil.which(words[0]):
            return [found, *words[1:]]
    raise NoCompiler(f"CC={chosen[0]}: command not found" if chosen else "there is no C compiler")


def _version_of(compiler: list[str]) -> str:
    try:
        return _run([*compiler, "--version"]).stdout.partition("\n")[0]
    except (OSError, subprocess.SubprocessError) as error:
        raise NoCompiler(f"{compiler[0]} does not run") from error


def _run(words: list[str], text: str = "") -> subprocess.CompletedProcess[str]:
    how: dict[str, Any] = {"text": True, "errors": "replace", "timeout": TIMEOUT_S}
    return subprocess.run(words, input=text, capture_output=True, check=False, **how)


def _is_ours(library: Path) -> bool:
    try:
        about = library.lstat()
    except OSError:
        return False
    return stat.S_ISREG(about.st_mode) and about.st_uid == os.geteuid() and not about.st_mode & WRITABLE_BY_OTHERS


def _compile(compiler: list[str], text: str, library: Path) -> None:
    """Compile under another name, then rename: other processes see the whole library or none."""
    number, name = tempfile.mkstemp(".tmp", dir=library.parent)
    os.close(number)
    made = Path(name)
    try:
        done = _run([*compiler, *OPTIONS, "-o", name, "-lm"], text)
        if done.returncode:
            lines = [*done.stderr.splitlines(), "it fails"]
            raise NoCompiler(f"{compiler[0]}: {next((each for each in lines if 'error' in each), lines[0])}")
        if not made.stat().st_size:
            raise NoCompiler(f"{compiler[0]} wrote nothing")
        made.chmod(0o700)
        made.replace(library)
    except subprocess.SubprocessError as error:
        raise NoCompiler(f"{compiler[0]} does not run") from error
    finally:
        made.unlink(missing_ok=True)
