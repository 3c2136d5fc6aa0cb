"""Compile a C text to a shared library with the machine's compiler, and keep it in the user's cache."""

from __future__ import annotations

import contextlib
import grp
import hashlib
import os
import pwd
import shlex
import shutil
import stat
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from .flags import FLAGS

OPTIONS = (*FLAGS, "-fno-fast-math", "-fPIC", "-shared", "-w", "-x", "c", "-")
COMPILERS = ("cc", "gcc", "clang")
TIMEOUT_S = 120
WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class NoCompiler(Exception):
    """There is no C compiler, or it fails: the message is one line."""


class UnsafeCache(Exception):
    """The cache's folder is not the user's alone: the message is one line."""


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
