"""Phalanx keeps robot swarms in honest hands: who may command, what may be done, what is really done.

Its packages, each imported when it is first used:

    link        who may command: servers and clients behind a QR code
    mission     what may be done: missions that a robot can read only by experiencing them
    bti         what is really done: logs, audits, tokens
    robot       one robot, its controllers, and the interface of a swarm
    world       simulated swarms: scenarios, `simulate`, arrays
    gateway     pages for visitors and the operator, before any swarm
    net         brokers and sockets
    config      the papers' parameters
    errors      whose fault it is

Twelve robots audit each other; one stops to do what it is told, and is stopped:

    >>> from phalanx.world import simulate
    >>> result = simulate("flock-12", attacks="hijack:robot=5,at=10", every_s=0.5)
    >>> stopped_s = result.times_s[result.in_safe_mode[0, :, 4]][0]
    >>> print(result.positions_m.shape, 10 < stopped_s < 20.25)
    (1, 121, 12, 2) True
"""

# Nothing is imported here: Ctrl-C has a traceback until `__main__.py`, which comes after us, has its say.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

__all__ = ["__version__", "bti", "config", "errors", "gateway", "link", "mission", "net", "robot", "world"]


def __getattr__(name: str) -> "Any":
    # `import phalanx` alone is enough for `phalanx.link.Server`, and costs nobody the rooms that are not used.
    if name in __all__:
        from importlib import import_module  # noqa: PLC0415

        return import_module(f"phalanx.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
