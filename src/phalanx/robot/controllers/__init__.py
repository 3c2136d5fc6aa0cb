"""The controllers that robots run and auditors replay, and how a researcher adds one (python_controller.py)."""
