"""Scenario files, what the robots of a scenario run, and users' own files: for the simulator and for real robots."""
