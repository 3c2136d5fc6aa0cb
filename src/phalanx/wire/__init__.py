"""Bytes are defined once: the table, and the codec that reads it."""

from . import table
from .record import Field, MalformedRecord, Record

__all__ = ["Field", "MalformedRecord", "Record", "table"]
