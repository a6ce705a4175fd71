"""The table of the verification: rows, curves of convergence, the checks that yield them, and the report."""

from __future__ import annotations

import inspect
import math
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gfmdlayer.figures.plot_style import colours, new_figure, save, styled
from gfmdlayer.files.whole import write_text
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.verification import theory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """A comparison of theory with a result."""

    quantity: str
    theory: float
    found: float
    bound: float  # largest difference allowed
    source: str  # of the theory: equation, paper, book

    @property
    def inside(self) -> bool:
        """Whether the value found lies inside the bound; NaN does not."""
        return bool(abs(self.found - self.theory) <= self.bound)


@dataclass(frozen=True)
class Convergence:
    """Error against the number of points, the time step or a tolerance."""

    against: Literal["points", "step", "tolerance"]  # the abscissa
    label: str  # the quantity that converges
    x: tuple[float, ...]
    error: tuple[float, ...]
    slope: float  # by theory, on logarithmic axes

    @property
    def fitted(self) -> float:
        """Slope of the straight line through the points, by least squares."""
        return float(np.polyfit(np.log(self.x), np.log(self.error), 1)[0])

    def row(self, bound: float, source: str) -> Row:
        """Order of convergence as a row of the table."""
        return Row(f"order: {self.label}", abs(self.slope), abs(self.fitted), bound, source)


@dataclass(frozen=True)
class Check:
    """Rows that share a theory."""

    group: str  # section of the report
    # Yields rows and curves; the argument asks for small grids. The first line of its docstring is the title
    # of the check, the rest derives the bounds.
    find: Callable[[bool], Iterable[Row | Convergence]]
    peer: str = ""  # optional module that the check needs

    @property
    def title(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.find) or "").partition("\n")[0].rstrip(".")

    @property
    def derivation(self) -> str:
        """The rest of the docstring: how the bounds follow."""
        return (inspect.getdoc(self.find) or "").partition("\n")[2].strip()


@dataclass(frozen=True)
class CheckResult:
    """Result of a check."""

    rows: tuple[Row, ...] = ()  # in the order of the check, also those before a failure
    curves: tuple[Convergence, ...] = ()
    seconds: float = 0.0  # wall time
    failure: str = ""  # the error that ended the check, or empty
    missing: str = ""  # the module that is not installed, or empty

    @property
    def holds(self) -> bool:
        """Whether the check ended and every row lies inside its bound."""
        return not self.failure and all(row.inside for row in self.rows)


def carry_out(check: Check, quick: bool) -> CheckResult:
    """Carry out a check, with small grids if `quick`; an exception or no row is a failure of the check."""
    if check.peer and find_spec(check.peer) is None:
        return CheckResult(missing=check.peer)
    begun, failure = time.perf_counter(), ""
    results: list[Row | Convergence] = []
    try:
        results.extend(check.find(quick))
        if not any(isinstance(result, Row) for result in results):
            failure = "found nothing"
    except Exception as error:  # of any kind: reported, and the exit status is 1
        failure = f"{type(error).__name__}: {error}"
    return CheckResult(
        tuple(result for result in results if isinstance(result, Row)),
        tuple(result for result in results if isinstance(result, Convergence)),
        time.perf_counter() - begun,
        failure,
    )


# The report: the table in Markdown, the derivations, plots of convergence.

CheckResults = Sequence[tuple[Check, CheckResult]]

_HEAD = """\
| quantity | theory | found | bound | source | |
|----------|-------:|------:|------:|--------|-|"""
_AXES = {
    "points": ("number of points $n$", "relative error"),
    "step": (r"time step $\Delta t/\tau$", "error / largest value"),
    "tolerance": ("tolerance", r"error / largest $\tilde{p}$"),
}
_MARKERS = "os^Dv"


def write_report(out: Path, outcomes: CheckResults, quick: bool) -> None:
    """Write verification.md and its pictures."""
    curves = [curve for _, outcome in outcomes for curve in outcome.curves]
    pictures = [f"{against}.png" for against in _AXES if any(curve.against == against for curve in curves)]
    try:
        out.mkdir(parents=True, exist_ok=True)
        for picture in pictures:
            save(convergence_figure([c for c in curves if f"{c.against}.png" == picture]), out / picture)
        write_text(out / "verification.md", _markdown(outcomes, quick, pictures))
    except OSError as error:
        raise ResultsError(f"{out}: cannot be written: {error.strerror or error}") from error


def summary(outcomes: CheckResults) -> str:
    """Count the rows, in one sentence."""
    rows = [row for _, outcome in outcomes for row in outcome.rows]
    failed = sum(bool(outcome.failure) for _, outcome in outcomes)
    missing = sorted({outcome.missing for _, outcome in outcomes if outcome.missing})
    parts = [f"{sum(row.inside for row in rows)} of {len(rows)} rows inside their bounds"]
    parts += [f"{failed} check{'s' * (failed > 1)} failed"] * bool(failed)
    parts += [f"not installed: {', '.join(missing)}"] * bool(missing)
    return "; ".join(parts)


def row_cells(row: Row) -> tuple[str, ...]:
    """Write a row: quantity, theory, found, bound, source, inside or OUTSIDE."""
    numbers = (_number(value) for value in (row.theory, row.found, row.bound))
    return (row.quantity, *numbers, row.source, "inside" if row.inside else "OUTSIDE")


def _number(value: float) -> str:
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.10g}" if 1e-3 <= abs(value) < 1e6 else f"{value:.3e}"


def _markdown(outcomes: CheckResults, quick: bool, pictures: Sequence[str]) -> str:
    lines = ["# Verification", ""]
    lines += [f"**{summary(outcomes)}**{' (quick: small grids)' if quick else ''}", ""]
    lines += ["Bounds are on |found - theory|; they are derived below the table.", ""]
    for group, members in groupby(outcomes, key=lambda outcome: outcome[0].group):
        lines += [f"## {group}", "", _HEAD]
        for check, outcome in members:
            lines += _table_lines(check, outcome)
        lines += [""]
    if pictures:
        lines += ["## Convergence", "", "Dashed: the slope by theory, through the last point.", ""]
        lines += [*(f"![error against {picture[:-4]}]({picture})" for picture in pictures), ""]
    lines += ["## Derivation of the bounds", "", _escape(theory.__doc__ or ""), ""]
    for check, outcome in outcomes:
        lines += [f"**{check.title}** ({outcome.seconds:.1f} s). {_escape(check.derivation)}", ""]
    origin = {"written": now(), "machine": platform.platform(), **provenance()}
    lines += ["## Computed with", "", *(f"- {key}: {value}" for key, value in origin.items()), ""]
    return "\n".join(lines)


def _table_lines(check: Check, outcome: CheckResult) -> list[str]:
    rows: list[tuple[str, ...]] = [(f"**{check.title}**", "", "", "", "", ""), *map(row_cells, outcome.rows)]
    if outcome.missing:
        rows.append((outcome.missing, "", "", "", "", "not installed"))
    if outcome.failure:
        rows.append((f"failed: {outcome.failure}", "", "", "", "", "OUTSIDE"))
    return [
        f"| {' | '.join(cell.replace('|', chr(92) + '|').replace(chr(10), ' ') for cell in row)} |"
        for row in rows
    ]


def _escape(text: str) -> str:
    """Keep text from being read as Markdown; indented formulas are code already."""
    lines = text.strip().split("\n")
    return "\n".join(
        line if line.startswith("    ") else line.replace("*", r"\*").replace("<", r"\<") for line in lines
    )


def convergence_figure(curves: Sequence[Convergence]) -> Figure:
    """Draw error curves over the same abscissa on logarithmic axes, the slope by theory dashed."""
    from matplotlib.ticker import LogLocator

    with styled():
        figure = new_figure(1, 75.0)
        axes = figure.add_subplot()
        for i, (curve, colour) in enumerate(zip(curves, colours(len(curves)), strict=True)):
            x = np.array(curve.x)
            title = f"{curve.label}: {curve.fitted:+.2f} (theory {curve.slope:+g})"
            marker = _MARKERS[i % len(_MARKERS)]
            axes.plot(x, curve.error, marker, color=colour, mfc="none", label=title)
            axes.plot(x, curve.error[-1] * (x / x[-1]) ** curve.slope, "--", color=colour, linewidth=0.7)
        label, error = _AXES[curves[0].against]
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel=error)
        ends = [value for curve in curves for value in curve.x]
        if max(ends) < 100 * min(ends):  # fewer than two powers of ten to label
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
        figure.legend(loc="outside upper center", ncols=1, fontsize=7.5)
    return figure
