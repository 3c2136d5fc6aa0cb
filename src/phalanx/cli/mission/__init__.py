"""Implementations of `phalanx mission`, imported on demand."""
