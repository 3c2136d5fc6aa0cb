"""The base of the dataclasses that are generated from records of the byte table: they know their bytes."""

from __future__ import annotations

import struct
from operator import attrgetter, itemgetter
from typing import Any, ClassVar, Self

from .record import FLOATS, LARGEST_NUMBER, MalformedRecord, Record


class Typed:
    """A record with its fields as attributes: the first two are `id` and `t`, given by name, the others by position.

    Class attributes:
        RECORD: of the byte table; of a fixed length.
    """

    __slots__ = ()
    RECORD: ClassVar[Record]
    _names: ClassVar[tuple[str, ...]]  # of the fields, in the order of their bytes
    _values: ClassVar[Any]  # of an instance, in that order
    _floats: ClassVar[Any]  # of the tag and those values

    def __init_subclass__(cls) -> None:
        cls._names = tuple(field.name for field in cls.RECORD.fields)
        cls._values = attrgetter(*cls._names)
        cls._floats = itemgetter(*(n for n, field in enumerate(cls.RECORD.all_fields) if field.type in FLOATS))

    @classmethod
    def find(cls, raw: bytes, **beside: Any) -> Self | None:
        """Return the record in these bytes, with fields `beside` those of the byte table; None if they are none."""
        try:
            return cls.decode(raw, **beside)
        except MalformedRecord:
            return None

    @classmethod
    def decode(cls, raw: bytes, **beside: Any) -> Self:
        """Return the record in these bytes, with fields `beside` those of the byte table.

        Raises: MalformedRecord: of another length or kind; or a number is not finite, or above 10^6 in size.
        """
        record = cls.RECORD
        if len(raw) != record.size or raw[0] != record.tag:
            raise MalformedRecord(f"{len(raw)} bytes: not a {record.name}")
        _, sender, t, *rest = values = record.form.unpack(raw)
        if not _are_finite(cls._floats(values)):
            raise MalformedRecord(f"{record.name}: a number is not finite, or above 10^6 in size")
        return cls(*rest, id=sender, t=t, **beside)  # type: ignore[call-arg]  # a dataclass

    def encode(self, rob_id: int = 0, t_ms: int = 0) -> bytes:
        """Return the bytes; `rob_id` and `t_ms` stand in for an `id` and a `t` of 0.

        Raises: UsageError: a field does not fit.
        """
        sender, t, *rest = self._values(self)
        values = self.RECORD.tag, sender or rob_id, t or t_ms, *rest
        try:
            if _are_finite(self._floats(values)):
                return self.RECORD.form.pack(*values)
        except (struct.error, TypeError):
            pass
        return self.RECORD.encode(**dict(zip(self._names, values[1:], strict=True)))  # which says what does not fit


def _are_finite(numbers: tuple[float, ...]) -> bool:
    # Mostly all of them together are no larger than one may be. The sum with a NaN is one.
    return sum(map(abs, numbers)) <= LARGEST_NUMBER or all(abs(each) <= LARGEST_NUMBER for each in numbers)
