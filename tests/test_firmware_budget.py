"""The trusted nodes' budget fails for what it is there for."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parent.parent / "firmware"
CLOCK = "int phx_clock(phx_node *node, uint32_t now)\n{\n"


@pytest.fixture
def copy(tmp_path):
    """The firmware, for one target."""
    made = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, made, ignore=shutil.ignore_patterns("build", "fuzz", "__pycache__"))
    rules = made / "targets.mk"
    text = rules.read_text()
    rules.write_text(text.replace(text[text.index("TARGETS :=") :].splitlines()[0], "TARGETS := cortex-m3"))
    budget = made / "budget.json"
    rows = budget.read_text().splitlines(keepends=True)
    others = ("cortex-m0plus", "cortex-m33", "mips32")
    kept = [row for row in rows if not row.lstrip().startswith(tuple(f'"{each}"' for each in others))]
    budget.write_text("".join(kept).replace("},\n  },", "}\n  },"))
    return made


def verdict(firmware: Path) -> tuple[int, str]:
    done = subprocess.run([sys.executable, "budget.py"], cwd=firmware, check=False, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def test_it_holds_and_says_what_is_used(copy):
    code, said = verdict(copy)
    assert code == 0, said
    assert "stack_call" in said


@pytest.mark.parametrize(
    "was, instead, why",
    [
        (
            CLOCK,
            CLOCK + "    if (now % 7u == 3u) return phx_clock(node, now / 2u) + phx_clock(node, now / 3u);\n",
            "recursive",
        ),
        (CLOCK, "void *malloc(size_t);\n" + CLOCK + "    if (now == 7u) return malloc(now) != 0;\n", "malloc"),
        (CLOCK, CLOCK + "    static int calls;\n    if (calls++ > 9) return 1;\n", "bytes of its own"),
        (CLOCK, CLOCK + "    uint8_t wide[now % 9u + 1u];\n    phx_wipe(wide, sizeof wide);\n", "no fixed size"),
    ],
    ids=["recursion", "heap", "memory", "stack"],
)
def test_what_no_node_may_do_is_found(copy, was, instead, why):
    source = copy / "src" / "node.c"
    assert was in source.read_text()
    source.write_text(source.read_text().replace(was, instead))
    # What stands between "" and the README's row is counted by another test.
    script = copy / "budget.py"
    script.write_text(script.read_text().replace("for what, n in lines():", "for what, n in ():"))
    code, said = verdict(copy)
    assert code != 0
    assert why in said


def test_a_line_more_is_told(copy):
    source = copy / "src" / "node.c"
    source.write_text(source.read_text().replace(CLOCK, CLOCK + "    (void)node;\n"))
    code, said = verdict(copy)
    assert code != 0
    assert "README.md does not have this row" in said
