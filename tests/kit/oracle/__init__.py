"""The trusted nodes once more, in plain Python: what the C is held to, call by call."""
