"""The operator's desk for missions: what the building shows, a mission read, compiled and audited, and sent to robots.

Compiling takes its time (a slow hash for each way to see a node): threads do it, and whoever asks meanwhile is told how
far they are. One mission at a time: a new one takes the place of that being compiled.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
import os
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

from phalanx.errors import BadPayload, PhalanxError, Unknown, UsageError
from phalanx.mission import BuildOptions, Landmark, Mission, Node, Profile, build
from phalanx.mission.authoring.document import WrittenMission, alias_to_yaml, mission_to_yaml
from phalanx.mission.authoring.findable import mark_lookalikes_in
from phalanx.mission.landmarks import Site, landmarks_of
from phalanx.mission.landmarks.sites import is_shown
from phalanx.mission.worth.audit import Rates, audit_in
from phalanx.robot.on_mission import OnMission

log = logging.getLogger(__name__)

TEXT_MAX_BYTES = 15 * 1024  # in a request of a session
# Each is a slow hash of about 10 ms: half a minute of two cores.
LOCKS_MAX = 5000
# Of YAML: with them a few lines stand for a list without an end.
ALIASES_MAX = 100
SITES_MAX = 5000
DIGITS = 3  # millimetres


class _Replaced(Exception):
    """Another mission is wanted."""


@dataclass(slots=True)
class _Job:
    """A mission that is being compiled, or was."""

    locks: int = 0
    done: int = 0
    told: dict[str, Any] | None = None
    begin: Callable[[], None] | None = None
    id: str = ""
    replaced: bool = False


class MissionDesk:
    """One desk for one fleet and its building."""

    def __init__(self, swarm: OnMission) -> None:
        self._swarm = swarm
        self._job: _Job | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def world(self) -> dict[str, Any]:
        """The building, metres in the map's frame: its walls, where robots begin, and all the landmarks it shows."""
        return await asyncio.to_thread(lambda: self._world)

    @cached_property
    def _sites(self) -> Sequence[Site]:
        """All the landmarks of the building: seconds of work, if it is a large one."""
        return landmarks_of(self._swarm.plan)

    @cached_property
    def _world(self) -> dict[str, Any]:
        plan = self._swarm.plan
        return {
            "name": plan.name,
            "bounds": _rounded(plan.bounds),
            "start": None if plan.start is None else _rounded(plan.start[:2]),
            "walls": [_rounded(wall) for wall in plan.walls.tolist()],
            # Rooms tell apart more than each of their corners, and there are four of those in every one.
            "sites": [_site(site) for site in self._sites if site.type != "corner_convex"][:SITES_MAX],
        }

    async def read(self, text: str) -> dict[str, Any]:
        """Return a mission's YAML as an editor needs it. Raises: UsageError: it describes no mission; says where."""
        return await asyncio.to_thread(_read, text)

    async def running(self) -> dict[str, Any]:
        """Return the mission that runs as `read` does; empty: none runs, or only its files are known."""
        plain = self._swarm.plain()
        return await asyncio.to_thread(_drawn, mission_to_yaml(plain), plain) if plain else {}

    def compile(self, text: str, profile: Profile) -> None:
        """Begin to compile a mission's YAML; `job` tells what comes of it."""
        self.stop()
        self._job = _Job()
        task = asyncio.ensure_future(self._run(self._job, text, profile))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def stop(self) -> None:
        """Give up what is being compiled: whoever ends the program must not wait for it."""
        if self._job is not None:
            self._job.replaced = True

    async def _run(self, job: _Job, text: str, profile: Profile) -> None:
        try:
            job.told = await asyncio.to_thread(self._work, job, text, profile)
        except _Replaced:
            pass
        except PhalanxError as error:
            job.told = {"state": "failed", "error": str(error), "hint": getattr(error, "hint", "")}
        except Exception as error:
            log.exception("a mission cannot be compiled (%s)", type(error).__name__)
            job.told = {"state": "failed", "error": f"the compiler broke ({type(error).__name__})", "hint": ""}

    def _work(self, job: _Job, text: str, profile: Profile) -> dict[str, Any]:
        plain = _written(text).mission()
        self._swarm.check(plain)
        job.locks = sum(len(node.see) for node in plain.nodes)
        if job.locks > LOCKS_MAX:
            raise UsageError(f"a mission with {job.locks} ways to see its nodes", f"at most {LOCKS_MAX} from this page")
        worth = audit_in(self._swarm.plan, plain, profile)
        # One core less than there are: the gateway needs some of the last.
        with ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1)) as pool:

            def spread(work: Callable[[Any], Any], jobs: Iterable[Any]) -> Iterator[Any]:
                for answer in pool.map(work, jobs):
                    job.done += 1
                    if job.replaced:
                        pool.shutdown(wait=False, cancel_futures=True)
                        raise _Replaced
                    yield answer

            built = build(
                mark_lookalikes_in(self._swarm.plan, plain), BuildOptions(profile=profile), os.urandom, spread
            )
        job.begin = self._swarm.prepare(plain, built)
        job.id = built[0].mission.header.mission_id.hex()
        return {
            "state": "compiled",
            "id": job.id,
            "name": plain.name,
            "nodes": len(plain.nodes),
            "bytes": sum(len(each.mission.encode()) for each in built),
            "profile": profile.name.lower(),
            "audit": worth.to_json(),
            "rates": asdict(Rates()),
            "unseen": _unseen(plain, self._sites),
        }

    def job(self) -> dict[str, Any]:
        """Return the state or result of the last compilation."""
        if self._job is None:
            return {"state": "none"}
        return self._job.told or {"state": "compiling", "done": self._job.done, "of": self._job.locks}

    def send(self, mission_id: str) -> None:
        """Have robots begin a compiled mission. Raises: Unknown: there is no such one. PeerError: robots refuse it."""
        if self._job is None or self._job.begin is None or self._job.id != mission_id:
            raise Unknown("no such mission is compiled")
        self._job.begin()


def parse_profile(word: object) -> Profile:
    """The profile of this name. Raises: UsageError."""
    if isinstance(word, str) and word.upper() in Profile.__members__:
        return Profile[word.upper()]
    raise UsageError("no such profile", "sealed or paper")


def requests_of(desk: MissionDesk) -> dict[str, Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]]:
    """Return the requests of operators that a desk answers; what went wrong is an answer in words."""

    def asked(act: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]:
        async def answer(words: dict[str, Any]) -> dict[str, Any]:
            try:
                done = act(words)
                return (await done if inspect.isawaitable(done) else done) or {}
            except PhalanxError as error:
                return {"error": str(error), "hint": getattr(error, "hint", "")}

        return answer

    return {
        "mission_world": asked(lambda _: desk.world()),
        "mission_running": asked(lambda _: desk.running()),
        "mission_job": asked(lambda _: desk.job()),
        "mission_read": asked(lambda words: desk.read(_text(words, "mission"))),
        "mission_compile": asked(
            lambda words: desk.compile(_text(words, "mission"), parse_profile(words.get("profile")))
        ),
        "mission_send": asked(lambda words: desk.send(_text(words, "id"))),
    }


def _text(words: dict[str, Any], key: str) -> str:
    text = words.get(key)
    if not isinstance(text, str):
        raise BadPayload(f"{key!r} is a text")
    return text


def _written(text: str) -> WrittenMission:
    data = text.encode(errors="replace")
    if len(data) > TEXT_MAX_BYTES:
        raise UsageError(f"a mission of {len(data)} bytes", f"at most {TEXT_MAX_BYTES} from this page")
    if text.count("*") > ALIASES_MAX:
        raise UsageError("a mission that repeats itself too often", f"at most {ALIASES_MAX} aliases (*) from this page")
    return WrittenMission(data, "mission")


def _read(text: str) -> dict[str, Any]:
    written = _written(text)
    return _drawn(_named(written.words), written.mission())


def _drawn(words: dict[str, Any], plain: Mission) -> dict[str, Any]:
    """Return a mission as an editor needs it, from the words of its file and what they mean."""
    places = {node.name: _place(node) for node in plain.nodes}
    return {
        "name": plain.name,
        "nodes": [{"name": name, "words": value, **places[name]} for name, value in words["nodes"].items()],
        "ways": [way for told in words.get("ways", ()) for way in _ways(told)],
        # Parts that the editor cannot show are kept as in the file.
        "rest": {key: value for key, value in words.items() if key not in ("mission", "nodes", "ways")},
    }


def _named(words: Any) -> Any:
    """The words with texts for keys, as the compiler reads them: YAML takes `on` for yes, and JSON has it otherwise."""
    if isinstance(words, dict):
        return {str(key): _named(value) for key, value in words.items()}
    return [_named(value) for value in words] if isinstance(words, list) else words


def _place(node: Node) -> dict[str, Any]:
    kinds = [thing.type for alias in node.see for thing in alias if isinstance(thing, Landmark)]
    return {"at": None if node.place is None else _rounded(node.place), "type": kinds[0] if kinds else ""}


def _ways(words: Any) -> Iterator[dict[str, Any]]:
    """A way as the file has it, one entry for each pair of nodes."""
    if isinstance(words, list):
        yield from ({"from": str(a), "to": str(b), "both": True, "rest": {}} for a, b in pairwise(words))
        return
    rest = {key: value for key, value in words.items() if key not in ("from", "to", "both")}
    for end in words["to"] if isinstance(words["to"], list) else [words["to"]]:
        yield {"from": str(words["from"]), "to": str(end), "both": words.get("both", False), "rest": rest}


def _site(site: Site) -> dict[str, Any]:
    see = [alias_to_yaml((alias,), DIGITS) for alias in site.aliases]
    return {
        "type": site.type,
        "at": _rounded(site.place_m),
        "see": see[0] if len(see) == 1 else see,
        "width": round(site.width_m, DIGITS) or None,
    }


def _unseen(plain: Mission, sites: Sequence[Site]) -> list[str]:
    """Nodes of which the building shows no such landmark: no robot will find them. Codes can be hung up."""
    return [
        node.name
        for node in plain.nodes
        if not all(
            thing.text is not None or is_shown(thing, sites)
            for alias in node.see
            for thing in alias
            if isinstance(thing, Landmark)
        )
    ]


def _rounded(numbers: Iterable[float]) -> list[float]:
    return [round(float(number), DIGITS) for number in numbers]
