"""Tables of counts and ratios in Markdown, and the effort of a section."""

from __future__ import annotations

from dataclasses import dataclass

Cell = float | int | str | None


@dataclass(frozen=True)
class Table:
    """A table; all rows have the same keys, the headings of the columns."""

    name: str  # key in the JSON file
    title: str
    rows: list[dict[str, Cell]]  # None is an empty cell
    note: str = ""  # below the table

    def markdown(self) -> str:
        """Return the table in Markdown; numbers have three digits and are aligned to the right."""
        columns = list(self.rows[0])
        texts = [columns, *([_text(row[column]) for column in columns] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
        words = [any(isinstance(row[column], str) for row in self.rows) for column in columns]
        heads, *body = (
            "| "
            + " | ".join(
                text.ljust(width) if is_word else text.rjust(width)
                for text, width, is_word in zip(line, widths, words, strict=True)
            )
            + " |"
            for line in texts
        )
        rule = "|" + "|".join(
            "-" * (w + 1) + ("-" if word else ":") for w, word in zip(widths, words, strict=True)
        )
        note = ["", self.note] if self.note else []
        return "\n".join([f"### {self.title}", "", heads, rule + "|", *body, *note, ""])


@dataclass(frozen=True)
class Effort:
    """Size of the computations of a section."""

    points: tuple[int, ...]  # grid points n
    steps: int = 400  # of 0.005 tau
    repetitions: int = 5  # of each measured time; the median counts
    cases: int = 1  # of a sweep


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 1000 else f"{cell:.0f}"
    return str(cell)
