"""Daemons: one robot as a process, and a gateway's radio among such robots."""
