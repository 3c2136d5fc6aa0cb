"""Check that a controller answers equal inputs with equal bytes, and find the first difference."""
