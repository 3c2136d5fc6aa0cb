"""A building, and simulated cameras and wheels of robots in it."""
