"""Simulated swarms in real time, as the gateway sees them."""
