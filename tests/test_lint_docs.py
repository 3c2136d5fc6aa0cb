"""The lint of prose finds what it looks for, and the documents pass it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPT = ROOT / "scripts" / "lint_docs.py"
LONG = "word " * 31


def lint(*pages):
    return subprocess.run([sys.executable, SCRIPT, *pages], capture_output=True, text=True, check=False)


def test_the_documents_pass():
    assert lint().stdout == ""


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (f"{LONG.strip()}.", "sentence of 31 words"),
        (f"- {LONG}\n  and more.", "sentence of 33 words"),
        ("x" * 111, "line of 111 characters"),
        ("[there](nowhere.md)", "leads nowhere: nowhere.md"),
        ("# A page\n\n[there](#no-such)", "leads nowhere: #no-such"),
        ("Liars stand.", "say 'compromised robot' instead of 'liar'"),
        ("| a | safe mode |", "say 'Safe Mode' instead of 'safe mode'"),
    ],
)
def test_a_fault_is_found(text, fault, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text)
    done = lint(page)
    assert done.returncode == 1
    assert fault in done.stdout


@pytest.mark.parametrize(
    "text",
    [
        f"| {LONG} | {'x' * 200} |",
        f"```text\n{LONG * 4}\n```",
        f"<!-- made:begin -->\n{LONG * 4}\n<!-- made:end -->",
        f"[link](https://example.org/{'x' * 200})",
        "# A page\n\n[here](#a-page) " + "Short one. " * 5,
        "The class `Liar`, a benchmark, Safe Mode and [a page](https://example.org/liar).",
    ],
)
def test_tables_code_generated_parts_addresses_and_terms_are_left_alone(text, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text)
    assert lint(page).stdout == ""
