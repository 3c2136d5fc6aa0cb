"""Key file of a swarm's owner: root of the master keys, robots that have one, the last mission number, signing keys.

The file is readable by its owner alone, and encrypted with a passphrase. It is saved before keys are handed out, so
that no mission number is used twice, even if the process is killed.
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
SEE_LIST = "see phalanx keys list for the robots that have one"
CREATE = "make one with phalanx keys create"


@dataclass(slots=True)
class Robot:
    """Robot whose trusted nodes have a master key; times are ISO dates, UTC, "" for never."""

    given: str
    retired: str = ""


@dataclass(slots=True, repr=False)
class Keys:
    """Content of the key file. Master keys are derived from `root`; signing keys are raw Ed25519 keys."""

    name: str
    root: bytes
    missions: int = 0  # highest mission number in use
    robots: dict[int, Robot] = field(default_factory=dict)
    signers: dict[str, bytes] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Keys of {self.name}>"

    @classmethod
    def new(cls, name: str) -> Keys:
        """Generate the keys of a swarm without robots."""
        return cls(name, secrets.token_bytes(ROOT_BYTES), signers={who: _new_signer() for who in SIGNERS})

    def provision(self, robot: int, now: str) -> bytes:
        """Return the master key for one robot's nodes, 20 bytes; possible only once for each robot.

        Each robot has its own, so that the next mission can exclude a lost robot; RoboRebound §3.2 has one for all.
        This makes no difference to the nodes. Raises: UsageError: the number is out of range, or has a key.
        """
        if not 1 <= robot <= LAST_ROBOT:
            raise UsageError(f"no robot can have the number {robot}", f"use 1 to {LAST_ROBOT}")
        if robot in self.robots:
            given = self.robots[robot].given
            raise UsageError(f"robot {robot} got its master key on {given}", "use another number: each gets one key")
        self.robots[robot] = Robot(now)
        return self._master(robot)

    def master(self, robot: int) -> bytes:
        """Return the master key of a robot's nodes. Raises: UsageError: it has none."""
        if robot not in self.robots:
            raise UsageError(f"robot {robot} has no master key", SEE_LIST)
        return self._master(robot)

    def retire(self, robot: int, now: str) -> None:
        """Exclude a robot from all future missions. Raises: UsageError: it has no key, or was retired."""
        if robot not in self.robots:
            raise UsageError(f"robot {robot} has no master key", SEE_LIST)
        if self.robots[robot].retired:
            raise UsageError(f"robot {robot} was retired on {self.robots[robot].retired}")
        self.robots[robot].retired = now

    def issue(self) -> tuple[int, dict[int, MissionKey]]:
        """Return the next mission's number and its key, blinded for each robot that is not retired.

        Save these keys before handing it out, because the number counts as used from now on.
        Raises: UsageError: there is no robot, or no number left.
        """
        living = [robot for robot, about in sorted(self.robots.items()) if not about.retired]
        if not living:
            raise UsageError("no robot has a master key", "run phalanx keys provision FILE ROBOT --out BOARD")
        if self.missions >= LAST_MISSION:
            raise UsageError("all mission numbers are used", "make a new key file and provision new boards")
        self.missions += 1
        mission = secrets.token_bytes(KEY_BYTES)
        sealed = {
            robot: seal_mission_key(self._master(robot), mission, secrets.token_bytes(KEY_BYTES), self.missions)
            for robot in living
        }
        return self.missions, sealed

    def renew(self, who: str) -> None:
        """Replace the signing key of role `who`, one of SIGNERS."""
        self.signers[who] = _new_signer()

    def signer(self, who: str) -> Ed25519PrivateKey:
        """Return the signing key of role `who`, one of SIGNERS."""
        return Ed25519PrivateKey.from_private_bytes(self.signers[who])

    def public(self, who: str) -> str:
        """Return the public key of role `who`, 64 hexadecimal digits."""
        return self.signer(who).public_key().public_bytes_raw().hex()

    def _master(self, robot: int) -> bytes:
        return hkdf_sha256(self.root, b"phalanx master key" + robot.to_bytes(2, "little"), KEY_BYTES)

    def plain(self) -> bytes:
        """Encode the content of the file, before encryption."""
        signers = {who: key.hex() for who, key in self.signers.items()}
        return json.dumps(asdict(self) | {"root": self.root.hex(), "signers": signers}).encode()

    @classmethod
    def parse(cls, plain: bytes) -> Keys:
        """Parse the output of `plain`. Raises: CorruptData: not valid."""
        try:
            content: dict[str, Any] = json.loads(plain)
            robots = {int(robot): Robot(**about) for robot, about in content["robots"].items()}
            # Files of an earlier version lack these signing keys.
            stored = {who: _new_signer().hex() for who in ("stops", "advice")} | content["signers"]
            signers = {who: bytes.fromhex(stored[who]) for who in SIGNERS}
            return cls(str(content["name"]), bytes.fromhex(content["root"]), int(content["missions"]), robots, signers)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise CorruptData("written by another version") from error


def _new_signer() -> bytes:
    return Ed25519PrivateKey.generate().private_bytes_raw()


def pem(key: Ed25519PrivateKey) -> bytes:
    """Return a signing key as an unencrypted PEM file, which has to be kept secret."""
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def create(path: Path, name: str, passphrase: str) -> Keys:
    """Create a key file. Raises: UsageError: `path` exists; Unavailable: it cannot be written."""
    with _alone(path):
        if path.exists() or path.is_symlink():
            raise UsageError(f"{path} exists already", "use another name: existing keys are never overwritten")
        keys = Keys.new(name)
        _write(path, keys, Lock.of(passphrase, secrets.token_bytes(SALT_BYTES)))
    return keys


@contextlib.contextmanager
def open_keyring(path: Path, passphrase: str, new_passphrase: str = "") -> Iterator[Keys]:
    """Yield a file's keys, and save changes. Raises: UsageError: damaged, or others may read it; Unavailable."""
    with _alone(path):
        try:
            lock, plain = unlock(read_sealed(path), passphrase)
            keys = Keys.parse(plain)
        except CorruptData as error:
            raise UsageError(f"{path} is damaged: {error}", "restore it from a backup") from error
        except NotAuthentic as error:
            raise UsageError(f"wrong passphrase for {path}", "use the one with which it was created") from error
        if new_passphrase:
            lock = Lock.of(new_passphrase, secrets.token_bytes(SALT_BYTES))
        yield keys
        if new_passphrase or keys.plain() != plain:
            _write(path, keys, lock)


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    # A separate lock file, because each change replaces the key file.
    beside = path.with_name(f".{path.name}.lock")
    try:
        lock = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise UsageError(f"cannot keep keys in {path}: {error.strerror}", "use a folder that you own") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def read_sealed(path: Path) -> bytes:
    """Return the encrypted content of a key file. Raises: UsageError: there is none, or others may read it."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise UsageError(f"{path} is not a regular file", CREATE)
            if status.st_mode & 0o077:
                raise UsageError(f"other users may read {path}", f"chmod 600 {path}")
            return file.read(LIMIT + 1)
    except OSError as error:
        hint = file_meant(path, CREATE) if isinstance(error, FileNotFoundError) else CREATE
        raise UsageError(f"cannot read {path}: {error.strerror}", hint) from error


def _write(path: Path, keys: Keys, lock: Lock) -> None:
    write_private(path, lock.seal(keys.plain(), secrets.token_bytes(NONCE_BYTES)).encode(), replace=True)
