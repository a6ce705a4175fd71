"""What `gfmdlayer verify` shows: closed forms, limits, orders, balances, and independent methods.

    rows.py          a row of the table, a curve of convergence, a check that finds them
    table.py         the checks, a line each; the place to add one
    runner.py        carries them out, and writes the report
    report.py        the table in Markdown, and the plots
    theory.py        closed forms, and what the grid and the solver do to them

and a module for each kind of check. Each check is a function that yields what it finds; its docstring says
what theory expects, and how the bounds follow.
"""

from gfmdlayer.verification.runner import verify

__all__ = ["verify"]
