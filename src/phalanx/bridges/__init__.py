"""Other systems, and what their packages are needed for."""
