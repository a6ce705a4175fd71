"""A row of the verification table, a curve of convergence, and the check that yields them."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Row:
    """A comparison of theory with a result.

    Parameters
    ----------
    quantity : str
        The quantity compared.
    theory, found, bound : float
        Its value by theory, its value found, and the largest difference allowed.
    source : str
        Source of the theory: equation, paper, book.
    """

    quantity: str
    theory: float
    found: float
    bound: float
    source: str

    @property
    def inside(self) -> bool:
        """Whether the value found lies inside the bound; NaN does not."""
        return bool(abs(self.found - self.theory) <= self.bound)


@dataclass(frozen=True)
class Curve:
    """Error against the number of points, the time step or a tolerance.

    Parameters
    ----------
    against : {"points", "step", "tolerance"}
        The abscissa.
    label : str
        The quantity that converges.
    x, error : tuple of float
        The points of the curve.
    slope : float
        Slope by theory, on logarithmic axes.
    """

    against: Literal["points", "step", "tolerance"]
    label: str
    x: tuple[float, ...]
    error: tuple[float, ...]
    slope: float

    @property
    def fitted(self) -> float:
        """Slope of the straight line through the points, by least squares."""
        return float(np.polyfit(np.log(self.x), np.log(self.error), 1)[0])

    def row(self, bound: float, source: str) -> Row:
        """Order of convergence as a row of the table."""
        return Row(f"order: {self.label}", abs(self.slope), abs(self.fitted), bound, source)


@dataclass(frozen=True)
class Check:
    """Rows that share a theory.

    Parameters
    ----------
    group : str
        Section of the report.
    find : callable
        Yields rows and curves; its argument is whether to use small grids. The first line of its docstring is
        the title of the check, the rest the derivation of the bounds.
    peer : str
        Optional module that the check needs.
    """

    group: str
    find: Callable[[bool], Iterable[Row | Curve]]
    peer: str = ""

    @property
    def title(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.find) or "").partition("\n")[0].rstrip(".")

    @property
    def derivation(self) -> str:
        """The rest of the docstring: how the bounds follow."""
        return (inspect.getdoc(self.find) or "").partition("\n")[2].strip()


@dataclass(frozen=True)
class Outcome:
    """Result of a check.

    Parameters
    ----------
    rows, curves : tuple
        Rows and curves in the order in which they were found, those before a failure included.
    seconds : float
        Wall time.
    failure : str
        The error that ended the check, or empty.
    missing : str
        The module that is not installed, or empty.
    """

    rows: tuple[Row, ...] = ()
    curves: tuple[Curve, ...] = ()
    seconds: float = 0.0
    failure: str = ""
    missing: str = ""

    @property
    def holds(self) -> bool:
        """Whether the check ended and every row lies inside its bound."""
        return not self.failure and all(row.inside for row in self.rows)


def carry_out(check: Check, quick: bool) -> Outcome:
    """Carry out a check; an exception, or no row at all, is a failure of the check.

    Parameters
    ----------
    check : Check
        The check.
    quick : bool
        Small grids.

    Returns
    -------
    Outcome
    """
    if check.peer and find_spec(check.peer) is None:
        return Outcome(missing=check.peer)
    begun, failure = time.perf_counter(), ""
    found: list[Row | Curve] = []
    try:
        found.extend(check.find(quick))
        if not any(isinstance(each, Row) for each in found):
            failure = "found nothing"
    except Exception as error:  # of any kind: reported, and the exit status is 1
        failure = f"{type(error).__name__}: {error}"
    return Outcome(
        tuple(each for each in found if isinstance(each, Row)),
        tuple(each for each in found if isinstance(each, Curve)),
        time.perf_counter() - begun,
        failure,
    )
