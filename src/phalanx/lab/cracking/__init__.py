"""Brute-force attacks on captured missions."""
