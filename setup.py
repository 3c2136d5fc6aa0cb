"""The C part of the build; everything else is in pyproject.toml (docs/adr/0010)."""

from setuptools import setup

setup(cffi_modules=["firmware/build.py:bound", "firmware/build.py:paper"])
