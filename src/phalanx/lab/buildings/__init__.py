"""Randomly generated buildings."""
