"""`gfmdlayer verify`: closed forms, limits, orders, energy balances, and independent methods."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, FAILED, Verbs, folder_name, refuse

if TYPE_CHECKING:
    from gfmdlayer.verification.rows import Check, Finding

_STATUSES = "exit status: 0 every row inside its bound; 1 some row outside; 2 bad input"
_WIDTHS = (66, 14, 14, 10)


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        verify,
        "compare with closed forms, limits, orders of convergence, energy balances and other methods",
        f"gfmdlayer verify --quick\n\n{_STATUSES}",
    )
    added.add_argument(
        "--out",
        metavar="DIR",
        type=folder_name,
        default="results/verification",
        help="folder for verification.md and its pictures (default: results/verification)",
    )
    added.add_argument("--quick", action="store_true", help="small grids: half a minute")
    added.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")


def verify(options: argparse.Namespace) -> int:
    """Compare with theory and with other methods."""
    import os

    from gfmdlayer.execution.workers import threads_each
    from gfmdlayer.results.schema import ResultsError

    if options.jobs < 1:
        return refuse(f"--jobs {options.jobs}: must be 1 or more")
    threads_each(os.environ)
    from gfmdlayer.verification import verify
    from gfmdlayer.verification.report import summary

    found: list[tuple[Check, Finding]] = []

    def told(check: Check, finding: Finding) -> None:
        found.append((check, finding))
        _print(check, finding)

    print(_line(("", "theory", "found", "bound")))
    try:
        holds = verify(Path(options.out), quick=options.quick, jobs=options.jobs, told=told)
    except ResultsError as error:
        return refuse(str(error))
    print(f"\n{summary(found)}\nwritten: {Path(options.out) / 'verification.md'}")
    return COMPLETE if holds else FAILED


def _print(check: Check, finding: Finding) -> None:
    """Print what a check found."""
    from gfmdlayer.verification.report import row_cells

    print(f"{check.title}", flush=True)
    for row in finding.rows:
        what, expected, found, bound, _, state = row_cells(row)
        print(f"{_line((what, expected, found, bound))}  {state}", flush=True)
    if finding.missing:
        print(f"  {finding.missing} is not installed")
    if finding.failure:
        print(f"  could not be carried out: {finding.failure}")


def _line(cells: tuple[str, ...]) -> str:
    what, *numbers = cells
    aligned = (number.rjust(width) for number, width in zip(numbers, _WIDTHS[1:], strict=True))
    return f"  {what.ljust(_WIDTHS[0])}{' '.join(aligned)}"
