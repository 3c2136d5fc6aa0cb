"""Robots that carry out an encoded mission in a simulated building."""
