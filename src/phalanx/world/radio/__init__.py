"""Shared radio channel of all robots, validated against ns-3."""
