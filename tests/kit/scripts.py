"""Scripts of the tree, which are in no package: import one, and keep its workers in this process."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"script_{path.parent.name}_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


def in_this_process(monkeypatch, script: ModuleType) -> ModuleType:
    """Runs are lived in this process: another would have to find the script by its name."""

    class Pool:
        def __init__(self, *_): ...

        def __enter__(self):
            return self

        def __exit__(self, *_): ...

        imap_unordered = staticmethod(map)

    monkeypatch.setattr(script, "get_context", lambda _: type("", (), {"Pool": Pool}))
    return script
