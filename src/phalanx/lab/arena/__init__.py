"""A world of bodies and a radio in real time, for robots that are processes."""
