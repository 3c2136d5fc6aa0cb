"""MCAP files: write them, and read whatever such a file holds within limits."""
