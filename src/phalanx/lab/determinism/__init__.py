"""Check that a controller answers the same inputs with the same bytes, and find the first difference."""
