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
class Curve:
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
    find: Callable[[bool], Iterable[Row | Curve]]
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
class Outcome:
    """Result of a check."""

    rows: tuple[Row, ...] = ()  # in the order of the check, also those before a failure
    curves: tuple[Curve, ...] = ()
    seconds: float = 0.0  # wall time
    failure: str = ""  # the error that ended the check, or empty
    missing: str = ""  # the module that is not installed, or empty

    @property
    def holds(self) -> bool:
        """Whether the check ended and every row lies inside its bound."""
        return not self.failure and all(row.inside for row in self.rows)


def carry_out(check: Check, quick: bool) -> Outcome:
    """Carry out a check, with small grids if `quick`; an exception or no row is a failure of the check."""
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
