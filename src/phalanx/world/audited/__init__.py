"""Robots that audit each other: the world as arrays, and the compiled loop of events over it."""
