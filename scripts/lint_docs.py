"""Check the prose of the documentation: python scripts/lint_docs.py [PAGE …]

Outside of tables, code and generated parts: lines of at most 110 characters, sentences of at most 30 words. Everywhere:
links that lead to a file and a heading, and no word that the glossary has under "not". ALLOWED has the exceptions: so
many faults at most. Retired words are allowed in decision records.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GLOSSARY = ROOT / "docs" / "glossary.md"
LINE_CHARACTERS, SENTENCE_WORDS = 110, 30
# Decisions of the past: a record is not rewritten.
ALLOWED = {
    "docs/adr/0005-frames.md": 1,
    "docs/adr/0007-thin-jwe.md": 1,
    "docs/adr/0009-small-packets.md": 4,
    "docs/adr/0011-radio-model.md": 8,
    "docs/adr/0012-determinism-of-controllers.md": 3,
    "docs/adr/0013-scenarios-and-recordings.md": 2,
    "docs/adr/0014-requests-that-cost-nothing.md": 6,
    "docs/adr/0015-budgets-of-auditors.md": 3,
    "docs/adr/0016-two-profiles.md": 6,
    "docs/adr/0017-bindings.md": 1,
    "docs/adr/0018-search-in-steps.md": 3,
    "docs/adr/0019-landmarks.md": 12,
    "docs/adr/0020-missions-under-audit.md": 5,
    "docs/adr/0022-wheels-for-strangers.md": 1,
    "docs/adr/0023-brakes.md": 5,
    "docs/adr/0025-a-pose-that-knows-its-doubt.md": 5,
    "docs/adr/0027-each-neighbour-its-share.md": 4,
    "docs/adr/0028-what-was-lost-is-said-again.md": 7,
    "docs/adr/0029-a-master-key-for-each-robot.md": 1,
    "docs/adr/0030-who-lacks-a-token-listens.md": 2,
    "docs/adr/0031-orders-are-signed.md": 4,
    "docs/adr/0032-ctrl-c-waits-for-python.md": 1,
    "docs/adr/0034-a-gateways-own-nodes.md": 1,
    "docs/adr/0035-advice-answers-a-reading.md": 1,
    "docs/adr/0036-who-lacks-tokens-asks-who-is-there.md": 4,
    "docs/adr/0038-one-robot.md": 1,
    "docs/adr/0040-sessions-instead-of-mls.md": 1,
}

FENCE = re.compile(r"^( *)(`{3,}|~{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
MADE = re.compile(r"<!-- ([\w-]+):begin -->.*?<!-- \1:end -->", re.DOTALL)
LINK = re.compile(r"\]\(([^()\s]+)\)")
ADDRESS = re.compile(r"\]\([^()\s]*\)(?:\{[^}]*\})?|https?://\S+")
MARKER = re.compile(r"^\s*(?:[-*+]|\d+\.|#+|>)\s+")
# A full stop, but not that of abbreviations, followed by what begins a sentence.
END = re.compile(r"(?<!\be\.g)(?<!\bi\.e)(?<!\bAlg)(?<!\bFig)(?<!\bFigs)(?<!\bvs)[.!?](?=[)\"*_]*(?:\s|$))")


def blank(found: re.Match[str]) -> str:
    """Return as many empty lines."""
    return "\n" * found[0].count("\n")


def prose(text: str) -> str:
    """Return the text with as many lines, those of code and of generated parts empty."""
    return MADE.sub(blank, FENCE.sub(blank, text))


def is_table(line: str) -> bool:
    """Return whether a line is a table's row, a picture or HTML."""
    return line.lstrip().startswith(("|", "![", "<"))


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield each paragraph, item or heading with the number of its first line."""
    first = 0
    lines: list[str] = []
    for number, line in enumerate([*text.splitlines(), ""], 1):
        begins = bool(MARKER.match(line))
        if lines and (not line.strip() or begins or is_table(line) or lines[-1].startswith("#")):
            yield first, " ".join(lines)
            lines = []
        if line.strip() and not is_table(line):
            first = first if lines else number
            lines.append(MARKER.sub(lambda mark: "#" if "#" in mark[0] else "", line).strip())


def words(sentence: str) -> int:
    """Count words; code in backticks counts as one, an address as none."""
    plain = re.sub(r"`[^`]*`", "CODE", ADDRESS.sub("]", sentence))
    return len(re.findall(r"[^\W_][\w'./-]*", plain))


def sentences(paragraph: str) -> list[str]:
    """Split at full stops, but not at those in code."""
    shielded = re.sub(r"`[^`]*`", lambda code: re.sub(r"[.!?]", "_", code[0]), ADDRESS.sub("]", paragraph))
    return [each for each in END.split(shielded) if each.strip()]


def anchors(page: Path) -> set[str]:
    """Return the names by which links find a page's headings."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub(blank, page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def synonyms() -> dict[str, str]:
    """Return the retired words, each with the glossary's term."""
    rows = [re.split(r" \|", line[2:]) for line in GLOSSARY.read_text().splitlines() if line.startswith("| ")]
    return {word.strip(): row[0] for row in rows[1:] for word in row[2].split(",") if word.strip() not in {"", "not"}}


def retired_words(line: str) -> Iterator[str]:
    """Yield a fault for each retired word of a line."""
    plain = re.sub(r"`[^`]*`|^:::.*", "", ADDRESS.sub("]", line))
    for word, term in SYNONYMS.items():
        if re.search(rf"(?<![\w-])({re.escape(word)}|{re.escape(word[0].upper() + word[1:])})s?(?![\w-])", plain):
            yield f"say {term!r} instead of {word!r}"


SYNONYMS = synonyms()


def faults_of_line(page: Path, line: str) -> Iterator[str]:
    """Yield the faults of a line: length, links, words."""
    if not is_table(line) and (length := len(ADDRESS.sub("]", line))) > LINE_CHARACTERS:
        yield f"line of {length} characters, at most {LINE_CHARACTERS}"
    for target in LINK.findall(line):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        found = (page.parent / path).resolve() if path else page
        if not found.exists() or (anchor and found.suffix == ".md" and anchor not in anchors(found)):
            yield f"link leads nowhere: {target}"
    if page != GLOSSARY and page.parent.name != "adr":
        yield from retired_words(line)


def faults(page: Path, text: str) -> Iterator[tuple[int, str]]:
    """Yield the faults of a page, each with its line number."""
    plain = prose(text)
    for number, line in enumerate(plain.splitlines(), 1):
        yield from ((number, what) for what in faults_of_line(page, line))
    for number, paragraph in paragraphs(plain):
        for sentence in sentences(paragraph):
            if (count := words(sentence)) > SENTENCE_WORDS:
                yield number, f"sentence of {count} words, at most {SENTENCE_WORDS}: {' '.join(sentence.split()[:8])} …"


def pages() -> list[Path]:
    """Return the documents that users read."""
    top = [ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")]
    return sorted([*top, *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.md")])


def main(arguments: list[str]) -> int:
    """Print each fault as a line; return 1 if there was one."""
    bad = 0
    for page in map(Path, arguments) if arguments else pages():
        page = page.resolve()  # noqa: PLW2901
        name = str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name
        found = sorted(faults(page, page.read_text()))
        most = ALLOWED.get(name, 0)
        for number, what in found if len(found) > most else ():
            print(f"{name}:{number}: {what}")
            bad = 1
    return bad


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
