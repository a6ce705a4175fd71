"""Verification: `gfmdlayer verify` compares results with theory, row by row.

    checks.py   the table of checks, and `verify`, which carries them out; add a check there
    rows.py     a row of the table, a curve of convergence, a check
    theory.py   closed forms of elastic contact, and bounds on the errors of grid and solver
    runs.py     runs of the paper's default case, in memory
    report.py   the table in Markdown, and the plots of convergence

The other modules contain the checks. A check is a function that yields rows; its docstring gives the theory
and derives the bounds.
"""

from gfmdlayer.verification.checks import verify

__all__ = ["verify"]
