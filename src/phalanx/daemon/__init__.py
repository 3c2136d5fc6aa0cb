"""One robot as a process of its own, and a gateway's radio among such robots."""
