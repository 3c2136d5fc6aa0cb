"""Estimate what a captured mission file reveals to an attacker, and whether robots can complete the mission."""
