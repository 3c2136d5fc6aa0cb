"""One radio channel for all robots, held to ns-3."""
