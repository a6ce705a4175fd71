"""A measured force curve: time, depth and force of an indenter, and what is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.measurement import FitError

FEWEST_ROWS = 8
GAP = 0.05  # of the duration: a longer pause between two rows, in which the force changes, is warned of
GAP_STEPS = 20  # usual steps between rows, for the same
LARGEST = 1e30


class CurveError(FitError):
    """A curve cannot be fitted; the message names it, and has a line for each reason."""


@dataclass(frozen=True)
class ForceCurve:
    """A measured force curve.

    Parameters
    ----------
    name : str
        Names the curve in messages and results.
    time : array_like, shape (rows,)
        Increasing.
    depth : array_like, shape (rows,)
        Depth of the indenter below the undeformed surface, as measured: up to a contact point and a drift.
    force : array_like, shape (rows,)
        Positive where it compresses.
    noise : float, optional
        Standard deviation of the force; estimated from the residual by default.
    position : tuple of float
        Place (x, y) on the sample, for maps.

    Raises
    ------
    CurveError
        Naming every row that cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> from gfmdlayer import ForceCurve
    >>> depth = np.linspace(0.0, 0.1, 50)
    >>> curve = ForceCurve("ramp", 10 * depth, depth, 2.0 * depth**1.5, noise=1e-3)
    >>> curve.time.size
    50
    """

    name: str
    time: FloatArray
    depth: FloatArray
    force: FloatArray
    noise: float | None = None
    position: tuple[float, ...] = field(default=())

    def __post_init__(self) -> None:
        for key in ("time", "depth", "force"):
            object.__setattr__(self, key, _column(self.name, key, getattr(self, key)))
        if reasons := list(self._faults()):
            raise CurveError("\n".join(f"curve {self.name}: {reason}" for reason in reasons))

    def _faults(self) -> Iterator[str]:
        sizes = {key: getattr(self, key).size for key in ("time", "depth", "force")}
        if len(set(sizes.values())) > 1:
            found = ", ".join(f"{size} of {key}" for key, size in sizes.items())
            yield f"holds {found}; must be equally many"
            return
        if self.time.size < FEWEST_ROWS:
            yield f"holds {self.time.size} rows; must be at least {FEWEST_ROWS}"
        sound = True
        for key in sizes:
            values = getattr(self, key)
            if (wrong := ~(np.abs(values) < LARGEST)).any():
                sound = False
                yield f"{key} is not a finite number in {_rows(wrong)}; must be one in every row"
        if sound and (back := np.diff(self.time, prepend=-np.inf) <= 0).any():
            yield f"time does not increase in {_rows(back)}; must increase from row to row"
        elif sound and np.ptp(self.depth) == 0:
            yield "the depth never changes; must be a column of depths"
        elif sound and self.force.max() <= 0:
            yield "no force is positive; must be positive where the indenter presses"
        if self.noise is not None and not 0 < self.noise < math.inf:
            yield f"noise = {self.noise!r}; must be > 0 and finite, or left out"

    def warnings(self) -> Iterator[str]:
        """Yield what is odd about the curve but does not prevent a fit."""
        steps = np.diff(self.time)
        lost = (steps > GAP_STEPS * np.median(steps)) & (steps > GAP * np.ptp(self.time))
        for row in np.flatnonzero(lost & (np.abs(np.diff(self.force)) > GAP * np.ptp(self.force))):
            yield (
                f"gap of {steps[row]:.4g} after row {row + 1} (time {self.time[row]:.6g}), in which the "
                "force changes; the depth is taken to change evenly there"
            )
        if np.corrcoef(self.depth, self.force)[0, 1] < 0:
            yield "the force falls where the depth grows: is a sign, or the order of the columns, wrong?"

    def in_units(self, time: float, length: float, force: float) -> ForceCurve:
        """Return the curve with its columns multiplied by the sizes of their units."""
        return replace(
            self,
            time=self.time * time,
            depth=self.depth * length,
            force=self.force * force,
            noise=None if self.noise is None else self.noise * force,
        )


def _column(name: str, key: str, values: ArrayLike) -> FloatArray:
    try:
        column = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise CurveError(f"curve {name}: {key} cannot be read as numbers") from None
    if column.ndim != 1:
        raise CurveError(f"curve {name}: {key} has {column.ndim} dimensions; must be a single column")
    return column


def _rows(wrong: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> str:
    """Name rows, counted from 1."""
    rows = np.flatnonzero(wrong) + 1
    shown = ", ".join(map(str, rows[:5]))
    more = f" and {rows.size - 5} more" if rows.size > 5 else ""
    return f"row{'s' * (rows.size > 1)} {shown}{more}"
