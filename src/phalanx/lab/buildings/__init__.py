"""Buildings that chance draws."""
