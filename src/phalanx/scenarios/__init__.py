"""Scenario files, controllers of their robots, and users' own files, for simulated and real robots."""
