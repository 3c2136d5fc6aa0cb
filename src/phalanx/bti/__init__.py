"""Bounded-time interaction: what is really done (docs/spec/rebound.md). Pure: bytes and a time in, bytes out."""
