"""Estimate the value of a captured file: by calculation, and by real attacks."""
