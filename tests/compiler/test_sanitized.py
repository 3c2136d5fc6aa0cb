"""The constructs' C, and that of violated checks, does nothing that ASan or UBSan knows to be undefined."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import constructs
import violations
from harness import build, kernels_of, load

KIT = Path(__file__).parents[1] / "kit"
SANITIZED = [
    *["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"],
    *["-fno-omit-frame-pointer", "-O1", "-g1", "-w"],
]
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1", "PYTHONMALLOC": "malloc"}


def library(name: str) -> str:
    done = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=False)
    path = done.stdout.strip()
    if not Path(path).is_absolute():
        pytest.skip(f"gcc has no {name}")
    return path


def run_sanitized(name: str, path: Path, inputs: int) -> subprocess.CompletedProcess[str]:
    preload = {"LD_PRELOAD": f"{library('libasan.so')} {library('libubsan.so')}"}
    command = [sys.executable, KIT / "sanitized.py", name, path, str(inputs)]
    return subprocess.run(command, env=os.environ | OPTIONS | preload, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("module", "inputs"), [(constructs, 20), (violations, 20)], ids=["constructs", "violations"])
def test_kernels_do_nothing_undefined(module, inputs, tmp_path):
    library("libasan.so")
    path = build(kernels_of(module), tmp_path, *SANITIZED)
    done = run_sanitized(module.__name__, path, inputs)
    assert done.returncode == 0, done.stderr[-4000:]
    assert f"{len(kernels_of(module))} kernels" in done.stdout
    assert module is constructs or " 0 violations" not in done.stdout


def test_the_sanitizers_see_what_is_undefined(tmp_path, monkeypatch):
    """A check that is taken away is seen: without that, the tests above would say nothing."""
    text = "import numpy as np\nfrom phalanx.arrays import I64x1\nfrom phalanx.kernel import kernel\n\n\n"
    module = load(text + "@kernel\ndef element(a: I64x1, i: int) -> int:\n    return a[i + 4]\n", tmp_path)
    import harness

    written = harness.c_of
    monkeypatch.setattr(harness, "c_of", lambda kernels: written(kernels).replace("violate(at, BAD_INDEX, i, n);", ";"))
    path = build(kernels_of(module), tmp_path, *SANITIZED)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    done = run_sanitized(module.__name__, path, 20)
    assert done.returncode != 0
    assert "AddressSanitizer: heap-buffer-overflow" in done.stderr
