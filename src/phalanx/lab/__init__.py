"""Tools for researchers: sweeps, scorecards, arenas, random buildings, attacks on captured missions."""
