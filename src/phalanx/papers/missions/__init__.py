"""Figures of the second paper: missions."""
