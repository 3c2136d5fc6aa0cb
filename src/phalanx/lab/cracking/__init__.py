"""Captured missions, read by brute force."""
