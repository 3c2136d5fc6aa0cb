#!/bin/sh
# Pins everything again: run it after changing dependencies in pyproject.toml, and commit what it writes.
set -eu
cd "$(dirname "$0")/.."
uv="uv pip compile --generate-hashes --universal --python-version 3.11 --no-header --upgrade"
$uv pyproject.toml --group build --extra reproduce -o requirements.lock
$uv pyproject.toml --group build --group dev --extra agent --extra reproduce -c requirements.lock -o requirements-dev.lock
echo coverage | $uv - -c requirements-dev.lock -o requirements-coverage.lock
echo uv | $uv - -o requirements-uv.lock
echo ziglang | $uv - -o requirements-zig.lock
grep -o '"ros-[^"]*"' pyproject.toml | tr -d '"' | $uv - -c requirements-dev.lock -o requirements-ros2.lock
$uv --group release -o requirements-release.lock
