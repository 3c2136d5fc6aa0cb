"""Arenas: worlds that researchers put around real robot processes."""
