"""Figures of the third paper: bounded-time interaction."""
