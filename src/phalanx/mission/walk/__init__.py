"""Execute a mission: search for the next node, check matches, give instructions; auditors replay the state."""
