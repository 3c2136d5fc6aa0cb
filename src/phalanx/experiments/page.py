"""One page of all figures and tables: what each paper says, what was found, whether they agree, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from .figure import Figure
from .statement import Statement

# Of the papers' figures and tables, those that nobody can measure here.
NOT_MEASURED = (
    ("Qrkey Figs. 1 to 3, 5, 6, Table I", "pictures of the protocol, the robot and the page; its topics"),
    ("Encoded graphs Figs. 1 to 7", "drawings of the method"),
    ("RoboRebound Figs. 1, 3, 4", "photographs and a wiring diagram"),
    ("RoboRebound Fig. 5b", "bytes in and out of a microcontroller: nothing here has its wires"),
    ("RoboRebound Table 3", "parameters; they are the defaults here"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What came of a figure: statements, or why there are none."""

    figure: Figure
    measured: str = ""  # how much of it, and by which version
    statements: Sequence[Statement] = ()
    failure: str = ""

    @property
    def differing(self) -> list[Statement]:
        """Of the statements, those in which ours is another than the paper's."""
        return [each for each in self.statements if not each.agrees]

    @property
    def verdict(self) -> str:
        """In a few words."""
        if self.failure:
            return f"not measured: {self.failure}"
        agree = len(self.statements) - len(self.differing)
        differs = f"; differs: {'; '.join(each.what for each in self.differing)}" if self.differing else ""
        return f"agrees in {agree} of {len(self.statements)}{differs}"


def page(command: str, version: str, shown: Sequence[Shown]) -> str:
    """The page, as Markdown; pictures lie beside it."""
    today = datetime.now(UTC).strftime("%-d %B %Y")
    parts = [
        "# The papers' figures and tables, and ours",
        f"{today}, `{command}`, phalanx {version}. What differs is a finding; the last column says what was asked.",
        _table(("figure", "shows", ""), ((each.figure.name, each.figure.about, each.verdict) for each in shown)),
    ]
    for each in shown:
        parts += [f"## {each.figure.name}", f"{each.figure.about}. {each.measured}".rstrip()]
        if each.failure:
            parts.append(f"Not measured: {each.failure}")
            continue
        heads = ("", "the paper", "reference", "ours, median (5 … 95 %)", "", "asked, or why")
        parts += [
            f"![{each.figure.about}]({each.figure.name}.png)",
            _table(
                heads,
                (
                    (one.what, one.paper, one.reference, one.ours, "agrees" if one.agrees else "**differs**", one.why)
                    for one in each.statements
                ),
            ),
        ]
    parts += ["## Not measured", _table(("what", "is"), NOT_MEASURED)]
    return "\n\n".join(parts) + "\n"


def _table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') or ' ' for cell in line)} |" for line in lines)
