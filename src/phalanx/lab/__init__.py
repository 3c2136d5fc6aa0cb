"""Researchers' tools around robots: sweeps, scorecards, arenas, random buildings, attacks on captured missions."""
