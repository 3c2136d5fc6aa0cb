"""Protocols beside flocking that RoboRebound names, one per file; the file's name is the protocol's name."""
