"""Simulated swarms in real time, for the gateway."""
