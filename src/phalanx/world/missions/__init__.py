"""Robots that live an encoded mission in a building."""
