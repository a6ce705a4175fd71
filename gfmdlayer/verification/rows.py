"""A row of the table, a curve of convergence, and a check that finds them."""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

import numpy as np

State = Literal["inside", "OUTSIDE", "not installed"]


@dataclass(frozen=True)
class Row:
    """What was compared.

    Attributes
    ----------
    what : str
        The quantity.
    expected, found, bound : float
        What theory says, what was found, and how far the two may be apart.
    source : str
        Where the expected value comes from: equation, paper, book.
    """

    what: str
    expected: float
    found: float
    bound: float
    source: str

    @property
    def state(self) -> State:
        """Whether what was found lies inside the bound; NaN does not."""
        return "inside" if abs(self.found - self.expected) <= self.bound else "OUTSIDE"


@dataclass(frozen=True)
class Curve:
    """Error against a number of points, a time step or a tolerance.

    Attributes
    ----------
    against : str
        The abscissa: "points", "step" or "tolerance".
    label : str
        What converges.
    x, error : tuple of float
        The points.
    slope : float
        Theory's, on logarithmic axes.
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


Finder = Callable[[bool], Iterable[Row | Curve]]


@dataclass(frozen=True)
class Check:
    """Rows that share a theory.

    Parameters
    ----------
    group : str
        What kind of check it is.
    find : callable
        Yields rows and curves; told whether to be quick, on small grids. Its docstring is the text of the
        check: a title, and how the bounds follow.
    peer : str
        The module that it needs, and that need not be installed.
    """

    group: str
    find: Finder
    peer: str = ""

    @property
    def title(self) -> str:
        """First line of the text."""
        return self._text().partition("\n")[0].rstrip(".")

    @property
    def derivation(self) -> str:
        """The rest of the text: how the bounds follow."""
        return self._text().partition("\n")[2].strip()

    def _text(self) -> str:
        return inspect.getdoc(self.find) or self.find.__name__.replace("_", " ")


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes
    ----------
    rows, curves : tuple
        As they were found, those before a failure among them.
    seconds : float
        Wall time.
    failure : str
        Why it could not be carried out to the end, if so.
    missing : str
        The peer that is not installed, if so.
    """

    rows: tuple[Row, ...]
    curves: tuple[Curve, ...]
    seconds: float
    failure: str = ""
    missing: str = ""

    @property
    def holds(self) -> bool:
        """Whether nothing lies outside its bound; what is not installed says nothing."""
        return not self.failure and all(row.state == "inside" for row in self.rows)


def carry_out(check: Check, quick: bool) -> Finding:
    """Carry out a check; one that raises has found that it does not hold."""
    if check.peer and find_spec(check.peer) is None:
        return Finding((), (), 0.0, missing=check.peer)
    begun, failure = time.perf_counter(), ""
    found: list[Row | Curve] = []
    try:
        found.extend(check.find(quick))
        if not any(isinstance(each, Row) for each in found):
            failure = "found nothing"
    except Exception as error:  # whatever it is, the report says so and the status is 1
        failure = f"{type(error).__name__}: {error}"
    return Finding(
        tuple(each for each in found if isinstance(each, Row)),
        tuple(each for each in found if isinstance(each, Curve)),
        time.perf_counter() - begun,
        failure,
    )


def write_number(value: float) -> str:
    """Write a number with as many digits as tell it from its neighbours in the table."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.10g}" if 1e-3 <= abs(value) < 1e6 else f"{value:.3e}"
