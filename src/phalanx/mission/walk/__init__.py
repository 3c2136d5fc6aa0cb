"""Living a mission: the search, what is found, the instruction in force, and the state that auditors replay."""
