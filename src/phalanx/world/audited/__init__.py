"""Robots that audit each other: the world as arrays, and the compiled event loop that advances it."""
