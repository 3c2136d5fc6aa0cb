"""Missions in the gateway: the operator's desk, and what visitors are told."""
