"""Whether a controller answers the same inputs with the same bytes, and if not, where it differs."""
