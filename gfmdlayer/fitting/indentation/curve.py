"""A measured force curve: time, depth and force of an indenter, with checks, straight pieces and units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.solve import corners
from gfmdlayer.validation.units import Units

FEWEST_ROWS = 8
GAP = 0.05  # of the duration: a longer pause between two rows gives a warning if the force changes in it
GAP_STEPS = 20  # and if it is this many times longer than the usual step
LARGEST = 1e30


class CurveError(FitError):
    """A curve cannot be fitted; the message names it and has one line for each reason."""


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
        Measured depth of the indenter below the undeformed surface, up to a contact point and a drift.
    force : array_like, shape (rows,)
        Positive where it compresses.
    noise : float, optional
        Standard deviation of the force; estimated from the residual by default.
    position : tuple of float
        Place (x, y) on the sample, for maps.

    Raises
    ------
    CurveError
        The message names every row that cannot be used.

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
            yield f"has {found}; give the same number of each"
            return
        if self.time.size < FEWEST_ROWS:
            yield f"has {self.time.size} rows; a fit needs at least {FEWEST_ROWS}"
        sound = True
        for key in sizes:
            values = getattr(self, key)
            if (wrong := ~(np.abs(values) < LARGEST)).any():
                sound = False
                yield f"{key} is not a finite number in {_rows(wrong)}"
        if sound and (back := np.diff(self.time, prepend=-np.inf) <= 0).any():
            yield f"time does not increase in {_rows(back)}; it must increase from row to row"
        elif sound and np.ptp(self.depth) == 0:
            yield "the depth never changes"
        elif sound and self.force.max() <= 0:
            yield "no force is positive; forces are positive where the indenter presses"
        if self.noise is not None and not 0 < self.noise < math.inf:
            yield f"noise = {self.noise!r}; it must be > 0 and finite, or None"

    def warnings(self) -> Iterator[str]:
        """Yield doubts about the curve that do not prevent a fit."""
        steps = np.diff(self.time)
        lost = (steps > GAP_STEPS * np.median(steps)) & (steps > GAP * np.ptp(self.time))
        for row in np.flatnonzero(lost & (np.abs(np.diff(self.force)) > GAP * np.ptp(self.force))):
            yield (
                f"the force changes in a gap of {steps[row]:.4g} after row {row + 1} (time "
                f"{self.time[row]:.6g}); the fit assumes that the depth changes evenly there"
            )
        if np.corrcoef(self.depth, self.force)[0, 1] < 0:
            yield "the force falls where the depth grows. Is a sign or the order of the columns wrong?"

    def in_units(self, time: float, length: float, force: float) -> ForceCurve:
        """Return the curve with each column multiplied by the size of its unit."""
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
        raise CurveError(f"curve {name}: {key} has {column.ndim} dimensions; give a single column")
    return column


def _rows(wrong: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> str:
    """Name rows, counted from 1."""
    rows = np.flatnonzero(wrong) + 1
    shown = ", ".join(map(str, rows[:5]))
    more = f" and {rows.size - 5} more" if rows.size > 5 else ""
    return f"row{'s' * (rows.size > 1)} {shown}{more}"


# The measured depth as straight pieces in time, and time points of a solution between their corners.
#
# A measured depth has noise and thousands of rows. Straight pieces replace it; their corners are rows, and
# they stay within `TOLERANCE` of the range or `SIGMAS` of the noise. The
# depths of the corners follow from least squares; corners that the noise explains are removed again. The
# pieces stay straight when a contact point and a drift are subtracted.

TOLERANCE = 1e-3  # of the range of the depth
SIGMAS = 4.5  # standard deviations of the noise: one row in 150 000 lies further away
CHANCE = 20.0  # a corner is removed if the sum of squares grows by less than this many variances
SHARP = 0.1  # of the largest rate: a larger jump of the rate is a breakpoint of the force


@dataclass(frozen=True)
class Drive:
    """A depth of straight pieces."""

    time: FloatArray  # shape (corners,)
    depth: FloatArray  # shape (corners,)
    error: float  # standard deviation of the measured depth from the pieces

    @classmethod
    def of(cls, time: FloatArray, depth: FloatArray) -> Drive:
        """Reduce a measured depth to straight pieces."""
        noise = 1.4826 * float(np.median(np.abs(np.diff(depth, 2)))) / 6**0.5
        within = TOLERANCE * float(np.ptp(depth))
        times = time[corners(time, depth, max(within, SIGMAS * noise))]
        if SIGMAS * noise > within:
            times = _pruned(time, depth, times, CHANCE * noise**2)
        at_corners, squares = _least_squares(time, depth, times)
        return cls(times, at_corners, (squares / time.size) ** 0.5)

    def corrected(self, contact_point: float, drift: float) -> Drive:
        """Return the depth below the contact point, without the drift."""
        return Drive(self.time, self.depth - contact_point - drift * (self.time - self.time[0]), self.error)

    @property
    def first_contact(self) -> tuple[int, float]:
        """The piece in which the depth first becomes positive, and the time.

        The first corner for a depth that is positive from the start; the last for one that is never positive.
        """
        if self.depth[0] >= 0:
            return 0, float(self.time[0])
        below = np.flatnonzero(self.depth > 0)
        if not below.size:
            return self.time.size - 2, float(self.time[-1])
        piece = int(below[0]) - 1
        before, after = self.depth[piece], self.depth[piece + 1]
        part = -before / (after - before)
        return piece, float(self.time[piece] + part * (self.time[piece + 1] - self.time[piece]))

    @property
    def breakpoints(self) -> FloatArray:
        """Times of the corners at which the rate jumps by a large part of itself, and of both ends."""
        rates = np.diff(self.depth) / np.diff(self.time)
        jumps = np.abs(np.diff(rates)) > SHARP * np.abs(rates).max()
        return np.asarray(self.time[np.concatenate(([True], jumps, [True]))])


def _pruned(time: FloatArray, depth: FloatArray, corners: FloatArray, chance: float) -> FloatArray:
    """Remove corners while the sum of squares grows by no more than `chance`."""
    squares = _least_squares(time, depth, corners)[1]
    while corners.size > 2:
        without = [np.delete(corners, i) for i in range(1, corners.size - 1)]
        sums = [_least_squares(time, depth, each)[1] for each in without]
        best = int(np.argmin(sums))
        if sums[best] > squares + chance:
            break
        corners, squares = without[best], sums[best]
    return corners


def _least_squares(time: FloatArray, depth: FloatArray, corners: FloatArray) -> tuple[FloatArray, float]:
    """Return the depths of the corners by least squares over all rows, and the sum of squares."""
    from scipy.linalg import solveh_banded

    piece = np.clip(np.searchsorted(corners, time, side="right") - 1, 0, corners.size - 2)
    right = (time - corners[piece]) / (corners[piece + 1] - corners[piece])
    left = 1 - right
    banded = np.zeros((2, corners.size))
    np.add.at(banded[1], piece, left**2)
    np.add.at(banded[1], piece + 1, right**2)
    np.add.at(banded[0], piece + 1, left * right)
    moment = np.zeros(corners.size)
    np.add.at(moment, piece, left * depth)
    np.add.at(moment, piece + 1, right * depth)
    found = np.asarray(solveh_banded(banded, moment))
    return found, float(np.sum((depth - np.interp(time, corners, found)) ** 2))


# Units of measured columns in headings, and their sizes in metres, seconds and newtons.

Sizes = tuple[float, float, float]
PREFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2,
    "k": 1e3, "M": 1e6,
}  # fmt: skip
BASES = {"time": {"s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0}, "depth": {"m": 1.0}, "force": {"N": 1.0}}
COLUMNS = ("time", "depth", "force")
_NAMES = {
    "time": {"t", "time"},
    "depth": {"d", "depth", "indentation", "delta", "displacement"},
    "force": {"f", "force", "load", "p"},
}
_HEADING = re.compile(r"\s*([^(\[/]*?)\s*(?:[(\[/]\s*([^)\]]*?)\s*[)\]]?)?\s*")


def size_of(unit: str, column: str) -> float | None:
    """Return the size of a unit of a column in SI; None for an unknown unit."""
    for base, size in BASES[column].items():
        if unit.endswith(base) and unit[: -len(base)] in PREFIXES:
            prefix = unit[: -len(base)]
            if prefix and base in {"min", "h", "sec"}:
                continue
            return PREFIXES[prefix] * size
    return None


def parse_heading(heading: str) -> tuple[str | None, str]:
    """Return the column that a heading names, or None, and its unit: ``Force (nN)`` is force and nN."""
    found = _HEADING.fullmatch(heading.strip().strip("\"'"))
    word, unit = (found[1], found[2] or "") if found else (heading, "")
    last = re.split(r"[\s_]+", word.strip().lower())
    for column, names in _NAMES.items():
        if word.strip().lower() in names or last[0] in names:
            return column, unit
    return None, unit


def in_si(units: Units | None) -> Sizes:
    """Return the sizes in SI of the units of time, length and force of a model; 1 without units."""
    if units is None:
        return 1.0, 1.0, 1.0
    time, length = size_of(units.time, "time"), size_of(units.length, "depth")
    stress = PREFIXES.get(units.stress.removesuffix("Pa")) if units.stress.endswith("Pa") else None
    if time is None or length is None or stress is None:
        raise ConfigError([f"units: got {units}; curves with units need metric ones, such as um, kPa and s"])
    return time, length, stress * length**2


def allowed(column: str) -> str:
    """Name the units of a column."""
    return {"time": "s, ms, min or h", "depth": "m, mm, um or nm", "force": "N, mN, uN, nN or pN"}[column]
