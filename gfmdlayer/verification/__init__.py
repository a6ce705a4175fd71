"""Verification: `gfmdlayer verify` compares found with theory, row by row.

    checks.py        the table of checks, and `verify`, which carries them out; the place to add one
    rows.py          a row of the table, a curve of convergence, a check
    report.py        the table in Markdown, and the plots of convergence
    theory.py        closed forms of elastic contact, and bounds on the errors of grid and solver
    runs.py          runs of the paper's default case, in memory
    third_order.py   the paper's Eq. (24), as an independent time integrator

The other modules hold the checks, a module for each group of the report. A check is a function that yields
rows; its docstring says what theory expects and derives the bounds.
"""

from gfmdlayer.verification.checks import verify

__all__ = ["verify"]
