"""Security for robot swarms: access control, encoded missions, and audits that stop compromised robots.

Its packages, each imported when it is first used:

    link        encrypted sessions between servers and clients, paired by a QR code
    mission     encoded missions: a robot decodes a step only where and when it is due
    bti         logs of robots, audits by neighbours, audit tokens
    robot       the program of one robot, its controllers, and the interface to a swarm
    world       simulated swarms: scenarios, `simulate`, arrays
    gateway     web pages for visitors and the operator of any swarm
    net         MQTT brokers and sockets
    config      parameters of the papers and of Phalanx
    errors      exceptions

Twelve robots audit each other. Robot 5 is compromised after 10 s and enters safe mode soon after:

    >>> from phalanx.world import simulate
    >>> result = simulate("flock-12", attacks="hijack:robot=5,at=10", every_s=0.5)
    >>> stopped_s = result.times_s[result.in_safe_mode[0, :, 4]][0]
    >>> print(result.positions_m.shape, 10 < stopped_s < 20.25)
    (1, 121, 12, 2) True
"""

# Import nothing here: until `__main__.py`, which runs next, sets the handler, Ctrl-C prints a traceback.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

__all__ = ["__version__", "bti", "config", "errors", "gateway", "link", "mission", "net", "robot", "world"]


def __getattr__(name: str) -> "Any":
    # After `import phalanx`, `phalanx.link.Server` works, and packages that are not used are not imported.
    if name in __all__:
        from importlib import import_module  # noqa: PLC0415

        return import_module(f"phalanx.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
