"""Check the prose of the documentation: python scripts/lint_docs.py [PAGE …]

Outside of tables, code and generated parts: lines of at most 110 characters, sentences of at most 30 words. Everywhere:
links that lead to a file and a heading. ALLOWED has the exceptions, each with its reason.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LINE_CHARACTERS, SENTENCE_WORDS = 110, 30
ALLOWED: dict[str, str] = {}

FENCE = re.compile(r"^( *)(`{3,}|~{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
MADE = re.compile(r"<!-- ([\w-]+):begin -->.*?<!-- \1:end -->", re.DOTALL)
LINK = re.compile(r"\]\(([^()\s]+)\)")
ADDRESS = re.compile(r"\]\([^()\s]*\)(?:\{[^}]*\})?|https?://\S+")
MARKER = re.compile(r"^\s*(?:[-*+]|\d+\.|#+|>)\s+")
# A full stop, but not that of abbreviations, followed by what begins a sentence.
END = re.compile(r"(?<!\be\.g)(?<!\bi\.e)(?<!\bAlg)(?<!\bFig)(?<!\bFigs)(?<!\bvs)[.!?](?=[)\"*_]*(?:\s|$))")


def blank(found: re.Match[str]) -> str:
    return "\n" * found[0].count("\n")


def prose(text: str) -> str:
    """Return the text with as many lines, those of code and of generated parts empty."""
    return MADE.sub(blank, FENCE.sub(blank, text))


def is_table(line: str) -> bool:
    """Tell whether a line is a table's row, a picture or HTML."""
    return line.lstrip().startswith(("|", "![", "<"))


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield each paragraph, item or heading with the number of its first line."""
    first, lines = 0, []
    for number, line in enumerate([*text.splitlines(), ""], 1):
        begins = bool(MARKER.match(line))
        if lines and (not line.strip() or begins or is_table(line) or lines[-1].startswith("#")):
            yield first, " ".join(lines)
            lines = []
        if line.strip() and not is_table(line):
            first = first if lines else number
            lines.append(MARKER.sub(lambda mark: "#" if "#" in mark[0] else "", line).strip())


def words(sentence: str) -> int:
    """Return how many words a reader reads: code in backticks and a number with its unit count once."""
    plain = re.sub(r"`[^`]*`", "CODE", ADDRESS.sub("]", sentence))
    return len(re.findall(r"[^\W_][\w'./-]*", plain))


def sentences(paragraph: str) -> list[str]:
    shielded = re.sub(r"`[^`]*`", lambda code: re.sub(r"[.!?]", "_", code[0]), ADDRESS.sub("]", paragraph))
    return [each for each in END.split(shielded) if each.strip()]


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", FENCE.sub(blank, page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def faults(page: Path, text: str) -> Iterator[tuple[int, str]]:
    """Yield what is wrong in a page: the line's number, and what."""
    plain = prose(text)
    for number, line in enumerate(plain.splitlines(), 1):
        shown = ADDRESS.sub("]", line)
        if not is_table(line) and len(shown) > LINE_CHARACTERS:
            yield number, f"line of {len(shown)} characters, at most {LINE_CHARACTERS}"
        for target in LINK.findall(line):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            found = (page.parent / path).resolve() if path else page
            if not found.exists() or (anchor and found.suffix == ".md" and anchor not in anchors(found)):
                yield number, f"link leads nowhere: {target}"
    for number, paragraph in paragraphs(plain):
        for sentence in sentences(paragraph):
            if (count := words(sentence)) > SENTENCE_WORDS:
                yield number, f"sentence of {count} words, at most {SENTENCE_WORDS}: {' '.join(sentence.split()[:8])} …"


def pages() -> list[Path]:
    return sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.md")])


def main(arguments: list[str]) -> int:
    """Print each fault as a line; return 1 if there was one."""
    bad = 0
    for page in map(Path, arguments) if arguments else pages():
        page = page.resolve()  # noqa: PLW2901
        name = str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name
        if name in ALLOWED:
            continue
        for number, what in sorted(faults(page, page.read_text())):
            print(f"{name}:{number}: {what}")
            bad = 1
    return bad


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
