"""Figures of the first paper: the link."""
