"""MCAP files: write recordings of runs, and read untrusted ones within limits."""
