#!/bin/sh
# Pins everything again: run it after changing dependencies in pyproject.toml, and commit what it writes.
set -eu
cd "$(dirname "$0")/.."
uv="uv pip compile pyproject.toml --generate-hashes --universal --python-version 3.11 --no-header --upgrade"
$uv --group build --extra reproduce -o requirements.lock
$uv --group build --group dev --extra reproduce -c requirements.lock -o requirements-dev.lock
