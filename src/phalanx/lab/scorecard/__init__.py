"""Scorecard: every attack against every defence in every protocol, with the outcomes."""
