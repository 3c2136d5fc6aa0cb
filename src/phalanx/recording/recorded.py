"""Read MCAP recordings sequentially, within size limits, without the index; truncated files too. Source: mcap.dev."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from phalanx.errors import Unavailable, UsageError

from .recorder import TOPICS

CUT_SHORT = "cut short"
MOST_CHUNK_BYTES = 1 << 24  # the recorder's chunks have 1 MiB, and at most one message more
MOST_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class Said:
    """A decoded message of a recording.

    Metadata have the topic "metadata NAME"; a truncated file ends with the topic CUT_SHORT.
    """

    topic: str
    t_ns: int
    words: Any


def is_recording(path: Path) -> bool:
    """Return True if a path looks like a recording, by its name or its first bytes."""
    if path.suffix == ".mcap":
        return True
    try:
        return path.is_file() and _begins(path)  # opening a pipe could block for ever
    except OSError:
        return False


def read_recording(path: Path, hint: str, most_bytes: int = MOST_BYTES) -> Iterator[Said]:
    """Yield the messages and metadata of a recording.

    Raises: UsageError: not a recording, or it unpacks to over `most_bytes`. Unavailable: the file cannot be read.
    """
    topics: dict[int, str] = {}
    try:
        for record in _records(path, hint, most_bytes):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Metadata):
                yield Said(f"metadata {record.name}", 0, record.metadata)
            elif isinstance(record, Message):
                topic = topics[record.channel_id]
                kind = TOPICS.get(topic)
                words = kind.FromString(record.data) if kind else json.loads(record.data)
                yield Said(topic, record.log_time, words)
    except EndOfFile as error:
        if not topics:
            problem = "was cut short before its first message" if _begins(path) else "is not a recording"
            raise UsageError(f"{path} {problem}", hint) from error
        yield Said(CUT_SHORT, 0, None)
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}", hint) from error
    except UsageError:
        raise
    except Exception as error:  # the parsers raise many types
        raise UsageError(f"{path} is not a recording, or is damaged", hint) from error


def _begins(path: Path) -> bool:
    """Return True if a file begins with the magic bytes of MCAP."""
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def _records(path: Path, hint: str, most_bytes: int) -> Iterator[Any]:
    """Yield records, with chunks unpacked; check the unpacked size before, as a file may state a false one."""
    if path.exists() and not path.is_file():  # reading a pipe without a writer would block
        raise UsageError(f"{path} is not a regular file", hint)
    unpacked = 0
    with path.open("rb") as file:
        whole: Any = _Whole(file)
        reader: Any = StreamReader(whole, emit_chunks=True, record_size_limit=MOST_CHUNK_BYTES)
        for record in reader.records:
            if not isinstance(record, Chunk):
                yield record
                continue
            size = max(record.uncompressed_size, len(record.data))
            if record.compression == "zstd":
                size = max(size, zstandard.frame_content_size(record.data))
            unpacked += size
            if record.compression not in ("zstd", ""):
                hint = "use zstd, or no compression"
                raise UsageError(f"{path} is compressed as {record.compression[:20]!r}", hint)
            if size > MOST_CHUNK_BYTES or unpacked > most_bytes:
                raise UsageError(f"{path} unpacks to more than the size limit", "use a recording made by phalanx")
            yield from breakup_chunk(record)


class _Whole:
    """A file whose `read` returns all requested bytes or raises: mcap would take a short read for complete."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def read(self, length: int) -> bytes:
        """Return `length` bytes. Raises: EndOfFile: fewer are left. ValueError: above MOST_CHUNK_BYTES."""
        if length > MOST_CHUNK_BYTES:
            raise ValueError(length)
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfFile
        return data
