"""Declarations of the commands: names, options and help. The implementations are in phalanx.cli, imported on demand.

No module here imports numpy or a network library, so help and completion respond at once.
"""
