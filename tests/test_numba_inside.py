"""numba promises nobody to stay as it is inside: this one has what we use of it, and without it kernels run all the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from phalanx import bundle, memory
from phalanx import kernel as kernel_module
from phalanx.sim import compiling
from phalanx.wire.fields import copy, whole

# Whatever of ours asks for what numba has inside is told that there is no such thing; numba itself is not.
ANOTHER_NUMBA = """
import builtins, json, sys
import_it, refused = builtins.__import__, set()

def of_another(name, globals=None, locals=None, fromlist=(), level=0):
    ours = (globals or {}).get("__name__", "").startswith("phalanx")
    if ours and name.startswith(("numba.core", "numba.np")):
        refused.add(globals["__name__"])
        raise ImportError(name)
    return import_it(name, globals, locals, fromlist, level)

builtins.__import__ = of_another
import numpy as np
from phalanx.bti import trusted
from phalanx.kernel import kept_in
from phalanx.pool import lend, make_pool
from phalanx.sim import compiling
from phalanx.sim.audited.events import make_queue, pop, push
from phalanx.wire import fields

def told(how):
    with compiling.telling_of_compiling(lambda *_: None):
        queue, pool, row = make_queue(4), make_pool(3, 8), np.arange(32, dtype=np.uint8)
        how(push)(queue, 7, 1, 2, 3)
        how(push)(queue, 5, 4, 5, 6)
        how(fields.copy)(row, 3, row, 1, 9)
        how(fields.put_u32)(row, 20, 70000)
        how(fields.put_f32)(row, 24, 0.1)
        digest = np.zeros(20, np.uint8)
        how(trusted.sha1)(row, 32, digest)
        return [
            how(pop)(queue), how(lend)(pool), how(lend)(pool), row.tolist(), digest.tolist(),
            [how(get)(row, 3) for get in (fields.get_i8, fields.get_u16, fields.get_u32, fields.get_u64)],
            [how(fields.same)(row, 3, row, 3 + k, 4) for k in (0, 1)],
        ]

print(json.dumps([told(lambda kernel: kernel), told(lambda kernel: kernel.py_func), kept_in(push), sorted(refused)],
                 default=int))
"""


def test_a_numba_that_is_another_inside_compiles_the_same_and_keeps_nothing(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(kernel_module.__file__).parent.parent)}
    run = subprocess.run([sys.executable, "-c", ANOTHER_NUMBA], capture_output=True, text=True, check=False, env=env)
    assert run.returncode == 0, run.stderr
    compiled, plain, folder, refused = json.loads(run.stdout)
    assert compiled == plain
    assert folder is None
    assert not list(tmp_path.rglob("*.nb?"))
    # Nobody else asks for it.
    assert refused == ["phalanx.bundle", "phalanx.kernel", "phalanx.memory", "phalanx.sim.compiling"]


def test_this_numba_has_all_that_we_use_of_its_inside():
    assert bundle.arrayobj is not None
    assert memory.arrays is not None
    assert compiling._EVENT is not None
    assert kernel_module.kept_in(whole) is not None
    assert hasattr(whole, "get_call_template")
    assert kernel_module._COUNTS
    copy(np.zeros(3, np.uint8), 0, np.zeros(3, np.uint8), 0, 1)
    assert isinstance(copy._cache, kernel_module.FunctionCache), "what is compiled is not kept any more"


def test_a_numba_that_keeps_what_it_compiles_in_another_way_compiles(monkeypatch):
    monkeypatch.setattr(kernel_module, "FunctionCache", lambda _function: SimpleNamespace(cache_path="/"))
    fresh = kernel_module.kernel(whole.py_func)
    assert fresh(3.5) == 3
    assert kernel_module.kept_in(fresh) is None
