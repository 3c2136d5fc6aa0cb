"""Connections to other robot systems. Only this package imports their libraries."""
