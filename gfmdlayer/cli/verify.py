"""`gfmdlayer verify`: compare with closed forms, limits, orders, energy balances and other methods."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, FAILED, refuse, verb

if TYPE_CHECKING:
    from gfmdlayer.verification.rows import Check, CheckResult

_STATUSES = "exit status: 0 every row inside its bound; 1 some row outside; 2 bad input"
_COLUMNS = "  {:66}{:>14} {:>14} {:>10}"

_VERIFY = """
--out DIR = results/verification  folder for verification.md and its pictures
  (default: results/verification)
--quick  small grids: less than a minute
--jobs N = 1  processes (default: 1)
"""


@verb(_VERIFY, f"gfmdlayer verify --quick\n\n{_STATUSES}")
def verify(options: argparse.Namespace) -> int:
    """Compare with closed forms, limits, orders, energy balances and other methods."""
    import os

    from gfmdlayer.study.workers import threads_each

    if options.jobs < 1:
        return refuse(f"--jobs {options.jobs}: must be 1 or more")
    threads_each(os.environ)
    from gfmdlayer.verification import verify
    from gfmdlayer.verification.rows import summary

    outcomes: list[tuple[Check, CheckResult]] = []

    def report(check: Check, outcome: CheckResult) -> None:
        outcomes.append((check, outcome))
        _print(check, outcome)

    print(_COLUMNS.format("", "theory", "found", "bound"))
    holds = verify(Path(options.out), quick=options.quick, jobs=options.jobs, report=report)
    print(f"\n{summary(outcomes)}\nwritten: {Path(options.out) / 'verification.md'}")
    return COMPLETE if holds else FAILED


def _print(check: Check, outcome: CheckResult) -> None:
    from gfmdlayer.verification.rows import row_cells

    lines = [check.title]
    for row in outcome.rows:
        quantity, theory, found, bound, _, state = row_cells(row)
        lines.append(f"{_COLUMNS.format(quantity, theory, found, bound)}  {state}")
    lines += [f"  {outcome.missing} is not installed"] * bool(outcome.missing)
    lines += [f"  failed: {outcome.failure}"] * bool(outcome.failure)
    print("\n".join(lines), flush=True)
