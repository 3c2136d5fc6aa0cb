"""Base class of the dataclasses that are generated from records of the byte table, with encoding and decoding."""

from __future__ import annotations

import struct
from operator import attrgetter, itemgetter
from typing import Any, ClassVar, Self

from .record import FLOATS, LARGEST_NUMBER, MalformedRecord, Record


class Typed:
    """A record with its fields as attributes: the first two, `id` and `t`, are keyword-only.

    Class attributes:
        RECORD: the record of the byte table, of fixed length.
    """

    __slots__ = ()
    RECORD: ClassVar[Record]
    _names: ClassVar[tuple[str, ...]]  # of the fields, in the order of their bytes
    _values: ClassVar[Any]  # getter of an instance's values, in that order
    _floats: ClassVar[Any]  # getter of the floats among the tag and those values

    def __init_subclass__(cls) -> None:
        cls._names = tuple(field.name for field in cls.RECORD.fields)
        cls._values = attrgetter(*cls._names)
        cls._floats = itemgetter(*(n for n, field in enumerate(cls.RECORD.all_fields) if field.type in FLOATS))

    @classmethod
    def find(cls, raw: bytes, **beside: Any) -> Self | None:
        """Decode bytes, with `beside` as fields that the byte table does not have; None if they are malformed."""
        try:
            return cls.decode(raw, **beside)
        except MalformedRecord:
            return None

    @classmethod
    def decode(cls, raw: bytes, **beside: Any) -> Self:
        """Decode bytes, with `beside` as fields that the byte table does not have.

        Raises: MalformedRecord: another length or tag, or a number that is not finite or above 10^6 in magnitude.
        """
        record = cls.RECORD
        if len(raw) != record.size or raw[0] != record.tag:
            raise MalformedRecord(f"{len(raw)} bytes: not a {record.name}")
        _, sender, t, *rest = values = record.form.unpack(raw)
        if not _are_finite(cls._floats(values)):
            raise MalformedRecord(f"{record.name}: a number is not finite, or above 10^6 in magnitude")
        return cls(*rest, id=sender, t=t, **beside)  # type: ignore[call-arg]  # a dataclass

    def encode(self, rob_id: int = 0, t_ms: int = 0) -> bytes:
        """Encode the record; `rob_id` and `t_ms` replace an `id` and a `t` of 0.

        Raises: UsageError: a field does not fit.
        """
        sender, t, *rest = self._values(self)
        values = self.RECORD.tag, sender or rob_id, t or t_ms, *rest
        try:
            if _are_finite(self._floats(values)):
                return self.RECORD.form.pack(*values)
        except (struct.error, TypeError):
            pass
        return self.RECORD.encode(**dict(zip(self._names, values[1:], strict=True)))  # raises, and names the field


def _are_finite(numbers: tuple[float, ...]) -> bool:
    # Fast path: usually even the sum is below the limit of one number. A sum with a NaN is NaN.
    return sum(map(abs, numbers)) <= LARGEST_NUMBER or all(abs(each) <= LARGEST_NUMBER for each in numbers)
