"""Carries the checks out, one by one or in several processes, and writes the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from gfmdlayer.verification.report import write_report
from gfmdlayer.verification.rows import Check, Finding, carry_out
from gfmdlayer.verification.table import CHECKS

Told = Callable[[Check, Finding], None]


def verify(
    out: Path | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    told: Told = lambda _check, _finding: None,
    checks: Sequence[Check] = CHECKS,
) -> bool:
    """Carry out the checks and write the report.

    Parameters
    ----------
    out
        Folder for verification.md and its pictures; made where there is none. Without it nothing is written.
    quick
        Whether to take small grids.
    jobs
        Processes.
    told
        Called with each check and what it found, in the order of the table.
    checks
        What to carry out; by default the whole table.

    Returns
    -------
    bool
        Whether every row lies inside its bound. Other codes that are not installed say nothing.

    Raises
    ------
    ResultsError
        If the report cannot be written.
    """
    if out is not None:
        write_report(out, [], quick)  # before the work, to learn whether it can be written
    found = []
    for check, finding in zip(checks, _findings(checks, quick, jobs), strict=True):
        told(check, finding)
        found.append((check, finding))
    if out is not None:
        write_report(out, found, quick)
    return all(finding.holds for _, finding in found)


def _findings(checks: Sequence[Check], quick: bool, jobs: int) -> Iterator[Finding]:
    task = partial(carry_out, quick=quick)
    if jobs == 1:
        yield from map(task, checks)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as team:
        yield from team.map(task, checks)
