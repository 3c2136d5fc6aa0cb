"""How many files we may have open: every connection is one."""

from __future__ import annotations

import resource


def allow_files(wanted: int) -> int:
    """How many we may open from now on: at least `wanted`, if the system lets us.

    The usual soft limit of 1024 is a classroom of phones, or one idler with a script.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    return files()


def files() -> int:
    """How many we may open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return 2**31 if soft == resource.RLIM_INFINITY else soft


def a_share(wanted: int, files_each: int = 1) -> int:
    """As many connections as wanted, of so many files each, or what fits a quarter of all files.

    A page, and the broker if it is in this process, leave the rest to the gateway itself.
    """
    return max(1, min(wanted, files() // 4 // files_each))
