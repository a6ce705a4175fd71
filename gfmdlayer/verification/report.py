"""The report: the table in Markdown, how the bounds follow, and plots of convergence."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import colours, new_figure, save, styled
from gfmdlayer.files.whole import write_text
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import ResultsError
from gfmdlayer.verification import theory
from gfmdlayer.verification.rows import Check, Curve, Finding, Row, write_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Found = Sequence[tuple[Check, Finding]]

_HEAD = """\
| what | expected from theory | found | bound | source | |
|------|---------------------:|------:|------:|--------|-|"""
_AXES = {
    "points": ("number of points $n$", "relative error"),
    "step": (r"time step $\Delta t/\tau$", "error / largest value"),
    "tolerance": ("tolerance", r"error / largest $\tilde{p}$"),
}
_MARKERS = "os^Dv"


def write_report(out: Path, found: Found, quick: bool) -> None:
    """Write verification.md and its pictures.

    Raises
    ------
    ResultsError
        If they cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        pictures = _draw(out, [curve for _, finding in found for curve in finding.curves])
        write_text(out / "verification.md", markdown(found, quick, pictures))
    except OSError as error:
        raise ResultsError(f"{out}: cannot be written: {error.strerror or error}") from error


def summary(found: Found) -> str:
    """Count the rows, in one sentence."""
    rows = [row for _, finding in found for row in finding.rows]
    outside = sum(row.state == "OUTSIDE" for row in rows)
    failed = sum(bool(finding.failure) for _, finding in found)
    missing = sorted({finding.missing for _, finding in found if finding.missing})
    parts = [f"{len(rows) - outside} of {len(rows)} rows inside their bounds"]
    parts += [f"{failed} check{'s' * (failed > 1)} failed"] * bool(failed)
    parts += [f"not installed: {', '.join(missing)}"] * bool(missing)
    return "; ".join(parts)


def row_cells(row: Row) -> tuple[str, ...]:
    """Write a row: what, expected, found, bound, source, state."""
    numbers = (write_number(value) for value in (row.expected, row.found, row.bound))
    return (row.what, *numbers, row.source, row.state)


def markdown(found: Found, quick: bool, pictures: Sequence[Path] = ()) -> str:
    """Write the report, whose pictures lie beside it."""
    about = {"made": now(), "machine": platform.platform(), **provenance()}
    lines = ["# Verification", ""]
    lines += [f"**{summary(found)}**{' (quick: small grids)' if quick else ''}", ""]
    lines += ["Bounds are on |found - expected|; how they follow is said below the table.", ""]
    for group, members in groupby(found, key=lambda each: each[0].group):
        lines += [f"## {group}", "", _HEAD]
        for check, finding in members:
            lines += _lines(check, finding)
        lines += [""]
    if pictures:
        lines += ["## Convergence", "", "Dashed: the slope of theory, through the last point.", ""]
        lines += [f"![error against {picture.stem}]({picture.name})" for picture in pictures]
        lines += [""]
    lines += ["## How the bounds follow", "", _paragraphs(theory.__doc__ or ""), ""]
    for check, finding in found:
        lines += [f"**{check.title}** ({finding.seconds:.1f} s). {_paragraphs(check.derivation)}", ""]
    lines += ["## Made with", "", *(f"- {key}: {value}" for key, value in about.items()), ""]
    return "\n".join(lines)


def _lines(check: Check, finding: Finding) -> list[str]:
    lines = [f"| **{check.title}** | | | | | |"]
    lines += ["| " + " | ".join(cell.replace("|", r"\|") for cell in row_cells(row)) + " |"
              for row in finding.rows]  # fmt: skip
    if finding.missing:
        lines.append(f"| {finding.missing} | | | | | not installed |")
    if finding.failure:
        reason = finding.failure.replace("|", r"\|").replace("\n", " ")
        lines.append(f"| could not be carried out: {reason} | | | | | OUTSIDE |")
    return lines


def _paragraphs(text: str) -> str:
    """Keep text from being taken for marks; indented formulas are code as they are."""
    lines = text.strip().split("\n")
    plain = (line.replace("*", r"\*").replace("<", r"\<") for line in lines)
    return "\n".join(
        line if line.startswith("    ") else told for line, told in zip(lines, plain, strict=True)
    )


def _draw(out: Path, curves: Sequence[Curve]) -> list[Path]:
    pictures = []
    for against in _AXES:
        chosen = [curve for curve in curves if curve.against == against]
        if chosen:
            pictures.append(out / f"{against}.png")
            save(convergence_figure(chosen), pictures[-1])
    return pictures


def convergence_figure(curves: Sequence[Curve]) -> Figure:
    """Draw error curves over the same abscissa on logarithmic axes, theory's slope dashed beside each."""
    from matplotlib.ticker import LogLocator

    with styled():
        figure = new_figure(1, 75.0)
        axes = figure.add_subplot()
        for i, (curve, colour) in enumerate(zip(curves, colours(len(curves)), strict=True)):
            _draw_curve(axes, curve, colour, _MARKERS[i % len(_MARKERS)])
        label, error = _AXES[curves[0].against]
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel=error)
        x = [value for curve in curves for value in curve.x]
        if max(x) < 100 * min(x):  # there may be a single power of ten to label
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
        figure.legend(loc="outside upper center", ncols=1, fontsize=7.5)
    return figure


def _draw_curve(axes: Axes, curve: Curve, colour: str, marker: str) -> None:
    x = np.array(curve.x)
    title = f"{curve.label}: {curve.fitted:+.2f} (theory {curve.slope:+g})"
    axes.plot(x, curve.error, color=colour, marker=marker, linestyle="none", mfc="none", label=title)
    axes.plot(
        x, curve.error[-1] * (x / x[-1]) ** curve.slope, color=colour, linestyle="dashed", linewidth=0.7
    )
