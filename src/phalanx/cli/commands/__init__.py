"""What the command line looks like: names, options, help. What a command does is in phalanx.cli, imported when it runs.

Nothing here imports numpy or a network library: help and completion are there at once.
"""
