"""What the owner of a swarm keeps: its master key, who has one, how far missions are counted, keys that sign.

One file, for its owner alone, sealed with a passphrase. Whatever is to be given out is on disk first: a number that may
have left this machine is never given again, whenever the process dies.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import secrets
import stat
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from phalanx.bti.nodes import MissionKey, seal_mission_key
from phalanx.config.written import file_meant
from phalanx.crypto.keys import LIMIT, NONCE_BYTES, SALT_BYTES, CorruptData, Lock, hkdf_sha256, unlock
from phalanx.errors import NotAuthentic, UsageError
from phalanx.wire.table import KEY_BYTES

from .private_file import write_private

ROOT_BYTES = 32
LAST_ROBOT, LAST_MISSION = 2**16 - 1, 2**32 - 1
SIGNERS = ("missions", "orders", "stops", "advice")


@dataclass(slots=True)
class Robot:
    """A robot whose trusted nodes have a master key; times are ISO dates, UTC, "" for never."""

    given: str
    retired: str = ""


@dataclass(slots=True, repr=False)
class Keys:
    """What the file says once it is open. `root` is what all masters are made of; signing keys are Ed25519, raw."""

    name: str
    root: bytes
    missions: int = 0  # the highest number given out
    robots: dict[int, Robot] = field(default_factory=dict)
    signers: dict[str, bytes] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Keys of {self.name}>"

    @classmethod
    def new(cls, name: str) -> Keys:
        """Keys of a swarm that has no robots yet."""
        return cls(name, secrets.token_bytes(ROOT_BYTES), signers={who: _new_signer() for who in SIGNERS})

    def provision(self, robot: int, now: str) -> bytes:
        """The master key of one robot's nodes, 20 bytes, given once.

        Each robot has its own, so that the next mission can leave out one that was lost; RoboRebound §3.2 has one for
        all. Nodes do not notice: a key is sealed for each. Raises: UsageError: the number is no robot's, or has a key.
        """
        if not 1 <= robot <= LAST_ROBOT:
            raise UsageError(f"robot {robot}", f"1 to {LAST_ROBOT}")
        if robot in self.robots:
            given = self.robots[robot].given
            raise UsageError(f"robot {robot} was given its master key on {given}", "once only: take another number")
        self.robots[robot] = Robot(now)
        return self._master(robot)

    def master(self, robot: int) -> bytes:
        """Return the master key that a robot's nodes were given. Raises: UsageError: it was given none."""
        if robot not in self.robots:
            raise UsageError(f"robot {robot} has no master key", "phalanx keys list shows who has")
        return self._master(robot)

    def retire(self, robot: int, now: str) -> None:
        """Leave a robot out of all missions to come. Raises: UsageError: it has no key, or was retired."""
        if robot not in self.robots:
            raise UsageError(f"robot {robot} has no master key", "phalanx keys list shows who has")
        if self.robots[robot].retired:
            raise UsageError(f"robot {robot} was retired on {self.robots[robot].retired}")
        self.robots[robot].retired = now

    def issue(self) -> tuple[int, dict[int, MissionKey]]:
        """The next mission's number, and its key, sealed for each robot that is not retired.

        To be handed out only when these keys are saved: the number counts as used from now on.
        Raises: UsageError: there is no robot, or no number left.
        """
        living = [robot for robot, about in sorted(self.robots.items()) if not about.retired]
        if not living:
            raise UsageError("no robot has a master key", "phalanx keys provision FILE ROBOT --out BOARD")
        if self.missions >= LAST_MISSION:
            raise UsageError("all numbers of missions are used", "new boards, and a new file of keys")
        self.missions += 1
        mission = secrets.token_bytes(KEY_BYTES)
        sealed = {
            robot: seal_mission_key(self._master(robot), mission, secrets.token_bytes(KEY_BYTES), self.missions)
            for robot in living
        }
        return self.missions, sealed

    def renew(self, who: str) -> None:
        """A new signing key for `who`; the old one is forgotten."""
        self.signers[who] = _new_signer()

    def signer(self, who: str) -> Ed25519PrivateKey:
        """The key that signs these, one of SIGNERS."""
        return Ed25519PrivateKey.from_private_bytes(self.signers[who])

    def public(self, who: str) -> str:
        """What checks that, 64 hexadecimal digits."""
        return self.signer(who).public_key().public_bytes_raw().hex()

    def _master(self, robot: int) -> bytes:
        return hkdf_sha256(self.root, b"phalanx master key" + robot.to_bytes(2, "little"), KEY_BYTES)

    def plain(self) -> bytes:
        """As it is sealed."""
        signers = {who: key.hex() for who, key in self.signers.items()}
        return json.dumps(asdict(self) | {"root": self.root.hex(), "signers": signers}).encode()

    @classmethod
    def parse(cls, plain: bytes) -> Keys:
        """As `plain`. Raises: CorruptData: it is not as we write it."""
        try:
            told: dict[str, Any] = json.loads(plain)
            robots = {int(robot): Robot(**about) for robot, about in told["robots"].items()}
            # An earlier version had none for some.
            kept = {who: _new_signer().hex() for who in ("stops", "advice")} | told["signers"]
            signers = {who: bytes.fromhex(kept[who]) for who in SIGNERS}
            return cls(str(told["name"]), bytes.fromhex(told["root"]), int(told["missions"]), robots, signers)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise CorruptData("sealed by another version") from error


def _new_signer() -> bytes:
    return Ed25519PrivateKey.generate().private_bytes_raw()


def pem(key: Ed25519PrivateKey) -> bytes:
    """A signing key as a file of its own; whoever reads it signs."""
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def create(path: Path, name: str, passphrase: str) -> Keys:
    """A new file of keys. Raises: UsageError: something of that name is there; Unavailable: it cannot be written."""
    with _alone(path):
        if path.exists() or path.is_symlink():
            raise UsageError(f"{path} is there already", "keys are never overwritten; take another name")
        keys = Keys.new(name)
        _write(path, keys, Lock.of(passphrase, secrets.token_bytes(SALT_BYTES)))
    return keys


@contextlib.contextmanager
def opened(path: Path, passphrase: str, new_passphrase: str = "") -> Iterator[Keys]:
    """Yield a file's keys; save what the body changed. Raises: UsageError: not ours alone, or damaged; Unavailable."""
    with _alone(path):
        try:
            lock, plain = unlock(read_sealed(path), passphrase)
            keys = Keys.parse(plain)
        except CorruptData as error:
            raise UsageError(f"{path} is damaged: {error}", "restore it from a backup") from error
        except NotAuthentic as error:
            raise UsageError(f"{path} was sealed with another passphrase", "the one it was made with") from error
        if new_passphrase:
            lock = Lock.of(new_passphrase, secrets.token_bytes(SALT_BYTES))
        yield keys
        if new_passphrase or keys.plain() != plain:
            _write(path, keys, lock)


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    # A file of its own: that of the keys is another with each change.
    beside = path.with_name(f".{path.name}.lock")
    try:
        lock = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise UsageError(f"cannot keep keys in {path}: {error.strerror}", "a folder that is yours") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def read_sealed(path: Path) -> bytes:
    """Return a file of keys, still sealed. Raises: UsageError: there is none, or others may read it."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise UsageError(f"{path} is no file", "phalanx keys create makes one")
            if status.st_mode & 0o077:
                raise UsageError(f"others may read {path}", f"chmod 600 {path}")
            return file.read(LIMIT + 1)
    except OSError as error:
        hint = "phalanx keys create makes one"
        hint = file_meant(path, hint) if isinstance(error, FileNotFoundError) else hint
        raise UsageError(f"cannot read {path}: {error.strerror}", hint) from error


def _write(path: Path, keys: Keys, lock: Lock) -> None:
    write_private(path, lock.seal(keys.plain(), secrets.token_bytes(NONCE_BYTES)).encode(), replace=True)
