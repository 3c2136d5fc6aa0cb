"""What the build does; what the package is, pyproject.toml says (docs/adr/0010, docs/adr/0022)."""

import os
import sys
import sysconfig
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).resolve().parent
sys.path[:0] = [str(ROOT / "release"), str(ROOT)]

from build_commands import KERNELS, BdistWheel, BuildExt, BuildPy, Sdist
from readme import for_index

# The same sources give the same bytes, whenever and wherever they are built: not the time of a checkout, nor the places
# of libraries that some Pythons would have written into what they link.
os.environ.setdefault("SOURCE_DATE_EPOCH", "1767225600")
link = [word for word in sysconfig.get_config_var("LDSHARED").split() if not word.startswith(("-L", "-Wl,-rpath"))]
os.environ.setdefault("LDSHARED", " ".join(link))

setup(
    cffi_modules=["firmware/build.py:hardened", "firmware/build.py:paper"],
    ext_modules=[KERNELS],
    cmdclass={"bdist_wheel": BdistWheel, "build_ext": BuildExt, "build_py": BuildPy, "sdist": Sdist},
    long_description=for_index(Path("README.md").read_text(encoding="utf-8")),
    long_description_content_type="text/markdown",
    # cffi compiles against the stable interface: one wheel for 3.11 and whatever comes.
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
