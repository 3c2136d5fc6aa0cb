"""The examples of docs/reference/kernels.md are compiled, and say the same compiled and as Python."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from harness import compiled, kernels_of, load

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "kernels.md"


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    return load("from __future__ import annotations\n" + "\n\n".join(blocks), tmp_path_factory.mktemp("page"))


def claims(module):
    tree = ast.parse(Path(module.__file__).read_text())
    return [ast.unparse(each.test) for each in tree.body if isinstance(each, ast.Assert)]


def test_each_example_says_the_same_compiled(example, tmp_path):
    kernels = kernels_of(example)
    called = {name for claim in claims(example) for name in re.findall(r"\w+", claim)}
    assert called >= {each.__name__ for each in kernels} - {"distance_m"}, "each kernel of the page is called"
    names = vars(example) | compiled(kernels, tmp_path)
    for claim in claims(example):
        assert eval(claim, dict(names)), claim
