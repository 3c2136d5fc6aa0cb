"""Read a recording as it lies in the file, without its index, within bounds, and a cut file up to there: mcap.dev."""

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
MOST_CHUNK_BYTES = 1 << 24  # ours are of 1 MiB, and a message more
MOST_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class Said:
    """A message of a topic of ours, read; a file's metadata, `metadata` and their name; or CUT_SHORT."""

    topic: str
    t_ns: int
    words: Any


def is_recording(path: Path) -> bool:
    """Return whether it is meant to be one, by its name or its first bytes."""
    if path.suffix == ".mcap":
        return True
    try:
        return path.is_file() and _begins(path)  # a pipe is not opened: that may take for ever
    except OSError:
        return False


def read_recording(path: Path, hint: str, most_bytes: int = MOST_BYTES) -> Iterator[Said]:
    """Yield what is in it. Raises: UsageError: no recording, or over `most_bytes`. Unavailable: it cannot be read."""
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
            what = "was cut short before its first part was whole" if _begins(path) else "is no recording"
            raise UsageError(f"{path} {what}", hint) from error
        yield Said(CUT_SHORT, 0, None)
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}", hint) from error
    except UsageError:
        raise
    except Exception as error:  # what reads a format raises what it likes
        raise UsageError(f"{path} is no recording, or damaged", hint) from error


def _begins(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def _records(path: Path, hint: str, most_bytes: int) -> Iterator[Any]:
    """Yield records, chunks unpacked, once it is known to how much they unpack: a file may lie about that."""
    if path.exists() and not path.is_file():  # a pipe that nobody writes would be waited for
        raise UsageError(f"{path} is no file", hint)
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
                hint = "only zstd is read, and what is not packed"
                raise UsageError(f"{path} is packed as {record.compression[:20]!r}", hint)
            if size > MOST_CHUNK_BYTES or unpacked > most_bytes:
                raise UsageError(f"{path} unpacks to more than is read", "phalanx writes no such file")
            yield from breakup_chunk(record)


class _Whole:
    """A file of which so much is read as was asked for: mcap takes the rest of a cut file for all of it."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def read(self, length: int) -> bytes:
        """So many bytes. Raises: EndOfFile: there are fewer. ValueError: nobody needs so many."""
        if length > MOST_CHUNK_BYTES:
            raise ValueError(length)
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfFile
        return data
