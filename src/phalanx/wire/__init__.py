"""The byte table, which defines every record once, and its codec."""

from . import table
from .record import Field, MalformedRecord, Record

__all__ = ["Field", "MalformedRecord", "Record", "table"]
