"""What the benchmark finds: tables of counts and ratios, and how they are written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

Cell = float | int | str | None


@dataclass(frozen=True)
class Table:
    """One table; the rows share their keys, which head the columns.

    Attributes
    ----------
    name : str
        Its key among the results.
    title : str
        What was counted, on what.
    rows : list of dict
        Cells by column; None where there is nothing to count.
    note : str
        How to read it.
    """

    name: str
    title: str
    rows: list[dict[str, Cell]]
    note: str = ""

    def markdown(self) -> str:
        """Return the table in Markdown, numbers to three digits and aligned to the right."""
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
    """How much a section computes.

    Attributes
    ----------
    points : tuple of int
        Numbers of grid points n.
    steps : int
        Time steps, of 0.005 tau each.
    repetitions : int
        Of each measured time; the median counts.
    cases : int
        Cases of a sweep.
    plot : Path, optional
        Where the section's figure goes, if it has one.
    """

    points: tuple[int, ...]
    steps: int = 400
    repetitions: int = 5
    cases: int = 1
    plot: Path | None = None


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 1000 else f"{cell:.0f}"
    return str(cell)
