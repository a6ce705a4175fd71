"""A measured force curve: its columns, segments and prescribed quantities, checks, straight pieces, units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import BoolArray, FloatArray, unmasked
from gfmdlayer.body.body import Body
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.equilibrium import EdgeAdhesion
from gfmdlayer.indentation.solve import corners
from gfmdlayer.punch.revolution import Revolution, abel_transform

FEWEST_ROWS = 8
QUIET = 0.05  # of the rows of an approach: those of the least force
GAP = 0.05  # of the duration: a longer pause between two rows gives a warning if the force changes in it
GAP_STEPS = 20  # and if it is this many times longer than the usual step
LARGEST = 1e30
FIRST, BENT = 0.1, -0.25  # part of the largest force, from which a parabola of force over depth bends so much
PRESCRIBED = ("depth", "force", "base")
DEPTH, FORCE, BASE = PRESCRIBED


class CurveError(FitError):
    """A curve cannot be fitted; the message names it and has one line for each reason."""


class Segment(NamedTuple):
    """Rows of a curve with one name and one prescribed quantity."""

    name: str  # approach, hold, retract, or a name of the file
    prescribed: str  # depth, force or base
    first: int  # the first row
    end: int  # the row after the last one

    def __str__(self) -> str:
        return f"{self.name} (rows {self.first + 1} to {self.end}, {self.prescribed} prescribed)"


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
    noise, depth_noise : float, optional
        Standard deviations of the force and of the depth; estimated from the residual by default.
    position : tuple of float
        Place (x, y) on the sample, for maps.
    prescribed : str or sequence of str, shape (rows,), optional
        The quantity that the instrument prescribes: `depth`, `force`, or the `base` of the cantilever, depth
        + force/stiffness. The fit minimises the error of the force where depth or base is prescribed, and of
        the depth where the force is. By default it is guessed from the straightness of the columns.
    segment : str or sequence of str, shape (rows,), optional
        Names of the segments, such as approach, hold, retract; guessed by default.
    stiffness, stiffness_error : float, optional
        Stiffness of the cantilever, force per length, and its relative standard error: with an error it is
        fitted too.
    punch : mapping, optional
        Indenter of this curve, with the keys of a configuration; by default the model's.
    weights : array_like, shape (rows,), optional
        Weights of the residuals, from 0, which leaves a row out, to 1.
    origin : mapping
        Facts for the record of a fit, such as the name and the digest of the file.

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
    >>> print(*curve.segments)
    approach (rows 1 to 50, depth prescribed)
    """

    name: str
    time: FloatArray
    depth: FloatArray
    force: FloatArray
    noise: float | None = None
    position: tuple[float, ...] = field(default=())
    prescribed: str | Sequence[str] | None = None
    segment: str | Sequence[str] | None = None
    depth_noise: float | None = None
    stiffness: float | None = None
    stiffness_error: float | None = None
    punch: Mapping[str, Any] | None = None
    weights: FloatArray | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key in ("time", "depth", "force"):
            object.__setattr__(self, key, column(self.name, key, getattr(self, key)))
        if self.weights is not None:
            object.__setattr__(self, "weights", column(self.name, "weights", self.weights))
        if reasons := list(self._faults()) or list(self._faults_of_segments()):
            raise CurveError("\n".join(f"curve {self.name}: {reason}" for reason in reasons))

    def _faults(self) -> Iterator[str]:
        sizes = {key: getattr(self, key).size for key in ("time", "depth", "force")}
        if len(set(sizes.values())) > 1:
            counts = ", ".join(f"{size} of {key}" for key, size in sizes.items())
            yield f"has {counts}; give the same number of each"
            return
        if self.time.size < FEWEST_ROWS:
            yield f"has {self.time.size} rows; a fit needs at least {FEWEST_ROWS}"
        if not self.time.size:
            return
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
        elif sound and np.ptp(self.force) == 0:
            yield "the force never changes"
        for key in ("noise", "depth_noise", "stiffness", "stiffness_error"):
            value = getattr(self, key)
            is_number = isinstance(value, (int, float, np.integer, np.floating))
            if value is not None and not (is_number and 0 < value < math.inf):
                yield f"{key} = {value!r}; it must be > 0 and finite, or None"
        if self.weights is not None and (
            self.weights.shape != self.time.shape or not ((self.weights >= 0) & (self.weights <= 1)).all()
        ):
            yield "weights must be one number from 0 to 1 for each row"
        if self.stiffness_error is not None and self.stiffness is None:
            yield "stiffness_error is given without a stiffness"

    def _faults_of_segments(self) -> Iterator[str]:
        rows = self.time.size
        for key in ("prescribed", "segment"):
            words = getattr(self, key)
            if not (words is None or isinstance(words, str)) and len(words) != rows:
                yield f"{key} has {len(words)} values for {rows} rows; give one for each row"
                return
        prescribed = [self.prescribed] if isinstance(self.prescribed, str) else self.prescribed
        wrong = [] if prescribed is None else sorted({str(kind) for kind in prescribed} - set(PRESCRIBED))
        if wrong:
            yield f"prescribed is {wrong[0]!r}; it must be one of {', '.join(PRESCRIBED)}"
            return
        kinds = {segment.prescribed for segment in self.segments}
        if BASE in kinds and self.stiffness is None:
            yield "the base is prescribed, but the stiffness of the cantilever is missing; give the stiffness"
        if {BASE, DEPTH} <= kinds:
            yield "prescribes the depth and the base; give one of them, or the force, in each segment"
        names = [segment.name for segment in self.segments if segment.name in {"approach", "retract"}]
        if "approach" in names and names[0] == "retract":
            yield "its segments are out of order: retract comes before approach"
        for segment in self.segments:
            moved = self.position_of_drive[segment.end - 1] - self.position_of_drive[segment.first]
            sense = {"approach": -1, "retract": 1}.get(segment.name, 0)
            if self.segment is not None and sense * moved > NEGLIGIBLE * np.ptp(self.position_of_drive):
                yield (
                    f"the segment {segment} moves {'away' if sense < 0 else 'inward'}; are the segments out "
                    "of order, or is a sign wrong?"
                )

    @cached_property
    def position_of_drive(self) -> FloatArray:
        """The base, where the stiffness is known; else the depth; shape (rows,)."""
        return self.depth if self.stiffness is None else self.depth + self.force / self.stiffness

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The segments, as given or guessed, one for each stretch of one name and one prescribed quantity."""
        names, kinds = (_by_row(words, self.time.size) for words in (self.segment, self.prescribed))
        for guess in _guess(self) if self.prescribed is None or self.segment is None else ():
            for row in range(guess.first, guess.end):
                names[row] = names[row] or guess.name
                kinds[row] = kinds[row] or guess.prescribed
        ends = [i for i in range(1, len(names)) if (names[i], kinds[i]) != (names[i - 1], kinds[i - 1])]
        return tuple(Segment(names[i], kinds[i], i, j) for i, j in pairwise([0, *ends, len(names)]))

    @cached_property
    def by_force(self) -> BoolArray:
        """Whether the force is prescribed in a row, and the depth measured; shape (rows,)."""
        rows = np.zeros(self.time.size, dtype=bool)
        for segment in self.segments:
            rows[segment.first : segment.end] = segment.prescribed == FORCE
        return rows

    @cached_property
    def indentation(self) -> tuple[float, float]:
        """The position at which contact begins, roughly, and the depth of the indentation below it.

        From an eighth of the largest force on, a force that grows like depth^(3/2) covers three quarters of
        the depth. Without an approach the position is the first one, the depth that of the whole column.
        """
        position = self.position_of_drive
        end = int(np.argmax(self.force)) + 1
        lowest, most = np.quantile(self.force[:end], QUIET), float(self.force[end - 1])
        low = np.flatnonzero(self.force[:end] < lowest + (most - lowest) / 8)
        depth = float(position[end - 1] - position[low[-1]]) / 0.75 if low.size else 0.0
        if not depth > 0:
            return float(position[0]), float(np.ptp(position))
        return float(position[end - 1]) - depth, depth

    @property
    def by_base(self) -> bool:
        """Whether the base is prescribed in a segment."""
        return any(segment.prescribed == BASE for segment in self.segments)

    def within(self, rows: slice, prescribed: str) -> FloatArray:
        """Return how far straight pieces may be from the prescribed quantity in some rows, shape (rows,).

        Parameters
        ----------
        rows : slice
            Rows of one segment.
        prescribed : str
            Quantity that is prescribed there: depth, force or base.
        """
        if prescribed == FORCE:
            return np.full(self.force[rows].shape, TOLERANCE * float(np.ptp(self.force)))
        begin, depth = self.indentation
        above = begin - depth - (self.depth if prescribed == DEPTH else self.position_of_drive)[rows]
        return TOLERANCE * depth + ABOVE * np.maximum(above, 0.0)

    @property
    def measured(self) -> FloatArray:
        """The force where depth or base is prescribed, the depth where the force is; shape (rows,)."""
        return np.where(self.by_force, self.depth, self.force)

    def warnings(self) -> Iterator[str]:
        """Yield doubts about the curve that do not prevent a fit."""
        steps = np.diff(self.time)
        lost = (steps > GAP_STEPS * np.median(steps)) & (steps > GAP * np.ptp(self.time))
        for row in np.flatnonzero(lost & (np.abs(np.diff(self.force)) > GAP * np.ptp(self.force))):
            yield (
                f"the force changes in a gap of {steps[row]:.4g} after row {row + 1} (time "
                f"{self.time[row]:.6g}); the fit assumes that the depth changes evenly there"
            )
        if np.ptp(self.force) > 0 and np.corrcoef(self.position_of_drive, self.force)[0, 1] < 0:
            yield "the force falls where the depth grows. Is a sign or the order of the columns wrong?"

    def looks_swapped(self) -> bool:
        """Whether the force bends down over the depth while it grows, as if the two were swapped."""
        rows = np.arange(self.segments[0].end if self.segments[0].end > FEWEST_ROWS else self.time.size)
        rows = rows[: int(np.argmax(self.force[rows])) + 1]
        rows = rows[self.force[rows] > FIRST * float(np.max(self.force))]
        if rows.size < FEWEST_ROWS or not np.ptp(self.position_of_drive[rows]) > 0:
            return False
        x, y = (values[rows] for values in (self.position_of_drive, self.force))
        x, y = (x - x.min()) / np.ptp(x), (y - y.min()) / np.ptp(y)
        return bool(np.polynomial.polynomial.polyfit(x, y, 2)[2] < BENT)

    @property
    def guessed(self) -> str:
        """A sentence on the segments and prescribed quantities that are guessed, or nothing."""
        missing = [
            words
            for words, value in (("segments", self.segment), ("prescribed quantities", self.prescribed))
            if value is None
        ]
        return f"{' and '.join(missing)} guessed" if missing else ""

    def in_units(self, time: float, length: float, force: float) -> ForceCurve:
        """Return the curve with each column multiplied by the size of its unit.

        Parameters
        ----------
        time, length, force : float
            Size of the unit of each column, in the new units.
        """

        def times(value: float | None, factor: float) -> float | None:
            return None if value is None else value * factor

        return replace(
            self,
            time=self.time * time,
            depth=self.depth * length,
            force=self.force * force,
            noise=times(self.noise, force),
            depth_noise=times(self.depth_noise, length),
            stiffness=times(self.stiffness, force / length),
        )


def _by_row(words: str | Sequence[str] | None, rows: int) -> list[str]:
    """Return a word for each row, empty where it is not given."""
    return [words or ""] * rows if words is None or isinstance(words, str) else list(map(str, words))


def column(name: str, key: str, values: ArrayLike) -> FloatArray:
    """Return values as a column of numbers."""
    try:
        numbers = np.array(unmasked(values), dtype=float)
    except (TypeError, ValueError):
        raise CurveError(f"curve {name}: {key} cannot be read as numbers") from None
    if numbers.ndim != 1:
        raise CurveError(f"curve {name}: {key} has {numbers.ndim} dimensions; give a single column")
    return numbers


def _rows(wrong: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> str:
    """Name rows, counted from 1."""
    rows = np.flatnonzero(wrong) + 1
    shown = ", ".join(map(str, rows[:5]))
    more = f" and {rows.size - 5} more" if rows.size > 5 else ""
    return f"row{'s' * (rows.size > 1)} {shown}{more}"


# The guess of segments and prescribed quantities.
#
# An instrument prescribes straight pieces in time; the other quantity bends. A hold lies where one of the two
# stays at its largest value. In each segment the quantity that is straighter, by `CLEARLY`, is prescribed;
# where both are equally straight or crooked, it is the position.

NEGLIGIBLE = 0.02  # of the range: a plateau is so even
PEAK = 0.6  # of it: how far the middle of a corner is above its ends; 1 without noise, 0 on a plateau
CLEARLY = 0.4  # of the other's distance from a straight line
FEWEST_OF_SEGMENT = 4
PRESSED = 0.05  # of the largest force: rows in contact


def noise_of(values: FloatArray) -> float:
    """Return the standard deviation of the noise of a smooth column, from its second differences."""
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / 6**0.5


def _guess(curve: ForceCurve) -> list[Segment]:
    position, rows = curve.position_of_drive, curve.time.size
    first, end = max(map(_plateau, (curve.force, position)), key=lambda plateau: plateau[1] - plateau[0])
    if end - first < max(FEWEST_OF_SEGMENT, rows // 50):  # no hold
        first = end = int(np.argmax(position)) + 1
    first = first if first >= FEWEST_OF_SEGMENT else 0
    end = end if rows - end >= FEWEST_OF_SEGMENT else rows
    parts = (("approach", 0, min(first, end)), ("hold", min(first, end), end), ("retract", end, rows))
    segments = [Segment(name, _prescribed(curve, i, j), i, j) for name, i, j in parts if j > i]
    moving = next((segment.prescribed for segment in segments if segment.name == "approach"), "")
    if moving == FORCE:  # a machine that prescribes the force while it moves does so in all segments
        return [segment._replace(prescribed=FORCE) for segment in segments]
    return [
        segment._replace(prescribed=moving) if moving and segment.name != "hold" else segment
        for segment in segments
    ]


def _plateau(values: FloatArray) -> tuple[int, int]:
    """Return the rows between which a column stays at its largest value; none where it turns."""
    within = max(NEGLIGIBLE * float(np.ptp(values)), SIGMAS * noise_of(values))
    level = float(np.max(values)) - within
    high = np.flatnonzero(values >= level)
    middle = float(np.median(values[high[0] : high[-1] + 1]))
    near = np.flatnonzero(np.abs(values - middle) <= within)
    first, end = int(near[0]), int(near[-1]) + 1
    quarter = (end - first) // 4
    inner, ends = values[first + quarter : end - quarter], np.r_[first : first + quarter, end - quarter : end]
    if quarter and float(inner.mean() - values[ends].mean()) > PEAK * within:
        return first, first
    return first, end


def _prescribed(curve: ForceCurve, first: int, end: int) -> str:
    position = DEPTH if curve.stiffness is None else BASE
    rows = np.arange(first, end)
    pressed = rows[curve.force[first:end] > PRESSED * float(np.max(curve.force))]
    rows = pressed if pressed.size >= FEWEST_ROWS else rows
    if rows.size < FEWEST_OF_SEGMENT:
        return position
    bends = []
    for values in (curve.force, curve.position_of_drive):
        line = np.polynomial.Polynomial.fit(curve.time[rows], values[rows], 1)
        squares = float(np.mean((values[rows] - line(curve.time[rows])) ** 2)) - noise_of(values[rows]) ** 2
        least = noise_of(values) / rows.size**0.5 + 1e-6 * float(np.ptp(values))
        bends.append(max(squares, least**2) ** 0.5 / float(np.ptp(values) or 1.0))
    return FORCE if bends[0] < CLEARLY * bends[1] else position


# A prescribed quantity as straight pieces in time.
#
# A measured depth, base or force has noise and thousands of rows. Straight pieces replace it, and stay within
# `TOLERANCE` of the indentation, or of the largest force, or `SIGMAS` of the noise. An approach may be a
# hundred indentations long: far above the surface the distance may be `ABOVE` of the height. A few corners
# may lie between rows, many are rows. The values at the corners follow from least squares, weighted by these
# distances; pieces are halved where they hide a bend within the noise, and corners that the noise explains
# are removed again. The pieces stay straight when a contact point and a drift are subtracted.

TOLERANCE = 3e-4
ABOVE = 0.1
SIGMAS = 4.5  # standard deviations of the noise: one row in 150 000 lies further away
ROOM = 0.45  # of a piece: largest shift of a corner into it
MOST_SHIFTED = 8, 20  # corners whose times are fitted too: of a precise and of a noisy column
CHANCE = 20.0  # a corner is removed if the sum of squares grows by less than this many variances
MOST_HALVED = 32  # corners of a noisy column before the last halving
SHARP = 0.1  # of the largest rate: a larger jump of the rate is a breakpoint of the response


@dataclass(frozen=True)
class StraightDrive:
    """A prescribed quantity of straight pieces."""

    time: FloatArray  # shape (corners,)
    value: FloatArray  # shape (corners,)
    error: float  # standard deviation of the measured values from the pieces
    # Of the values at the corners, then of the times of the inner ones where these are fitted too, over the
    # variance of a row; shape (fitted, fitted).
    covariance: FloatArray

    @classmethod
    def of(cls, time: FloatArray, values: FloatArray, within: FloatArray) -> StraightDrive:
        """Reduce measured values to straight pieces that stay within distances of them, shape (rows,)."""
        if time.size == 1:
            return cls(time, values, 0.0, np.zeros((1, 1)))
        noise = noise_of(values) if time.size > FEWEST_OF_SEGMENT else 0.0
        finest = float(within.min())
        within = np.maximum(within, SIGMAS * noise)
        rows = _WeightedRows(time, values, float(within.min()) / within)
        times = time[corners(time, values, within)]
        noisy, chance = SIGMAS * noise > finest, CHANCE * max(noise, finest / SIGMAS) ** 2
        if noisy:
            times = rows.straightened(rows.halved(times, chance), chance)
        if shifted := 2 < times.size <= MOST_SHIFTED[noisy]:  # corners lie between rows
            times = rows.fewest_shifted(times, chance)
        at_corners, squares = rows.fitted(times)
        columns = rows.derivatives(times, at_corners)[:, : None if shifted else times.size]
        freedom = max(float(np.sum(rows.weight**2)) - columns.shape[1], 1.0)
        covariance = np.asarray(np.linalg.pinv(columns.T @ columns), dtype=float)
        return cls(times, at_corners, (squares / freedom) ** 0.5, covariance)

    def moved(self, by: FloatArray) -> StraightDrive:
        """Return the drive with changes of its values, and of the times of its inner corners."""
        count = self.time.size
        inner = by[count:] if by.size > count else np.zeros(max(count - 2, 0))
        time = self.time + np.concatenate(([0.0], inner, [0.0]))[:count]
        return StraightDrive(time, self.value + by[:count], self.error, self.covariance)

    @property
    def breakpoints(self) -> FloatArray:
        """Times of the corners at which the rate jumps by a large part of itself, and of both ends."""
        rates = np.diff(self.value) / np.diff(self.time)
        if not rates.size:
            return self.time
        jumps = np.abs(np.diff(rates)) > SHARP * np.abs(rates).max()
        return np.asarray(self.time[np.concatenate(([True], jumps, [True]))])


class _WeightedRows(NamedTuple):
    """Measured values over time, with the weights of their distances from straight pieces."""

    time: FloatArray
    values: FloatArray
    weight: FloatArray

    def fewest_shifted(self, corners: FloatArray, chance: float) -> FloatArray:
        """Shift corners, and remove them while the sum of squares grows by no more than `chance`."""
        corners = self.shifted(corners)
        squares = self.fitted(corners)[1]
        while corners.size > 2:
            without = [self.shifted(np.delete(corners, i)) for i in range(1, corners.size - 1)]
            sums = [self.fitted(fewer)[1] for fewer in without]
            best = int(np.argmin(sums))
            if sums[best] > squares + chance:
                break
            corners, squares = without[best], sums[best]
        return corners

    def straightened(self, corners: FloatArray, chance: float) -> FloatArray:
        """Remove corners while the sum of squares grows by no more than `chance`.

        Without a kink c.x = 0 at a corner the sum grows by (c.x)^2/(c.A^-1 c), A the normal matrix.
        """
        from scipy.linalg import solveh_banded

        while corners.size > 2:
            banded, moment = self.normal(corners)
            values, steps, inner = (
                solveh_banded(banded, moment),
                np.diff(corners),
                np.arange(corners.size - 2),
            )
            kinks = np.zeros((corners.size, inner.size))
            kinks[inner, inner], kinks[inner + 2, inner] = 1 / steps[:-1], 1 / steps[1:]
            kinks[inner + 1, inner] = -1 / steps[:-1] - 1 / steps[1:]
            growth = (kinks.T @ values) ** 2 / np.sum(kinks * solveh_banded(banded, kinks), axis=0)
            if growth.min() > chance:
                break
            corners = np.delete(corners, int(np.argmin(growth)) + 1)
        return corners

    def halved(self, corners: FloatArray, chance: float) -> FloatArray:
        """Halve pieces while this lowers the sum of squares by more than `chance`."""
        squares = self.fitted(corners)[1]
        while corners.size < MOST_HALVED:
            middles = self.time[np.searchsorted(self.time, (corners[:-1] + corners[1:]) / 2)]
            halves = [at for at in middles if self.fitted(np.union1d(corners, at))[1] < squares - chance]
            if not (added := np.setdiff1d(halves, corners)).size:
                break
            corners = np.union1d(corners, added)
            squares = self.fitted(corners)[1]
        return corners

    def shifted(self, corners: FloatArray) -> FloatArray:
        """Return the times of the corners by least squares: noise puts them on wrong rows."""
        from scipy.optimize import least_squares

        if corners.size == 2:
            return corners

        def joined(inner: FloatArray) -> FloatArray:
            return np.concatenate((corners[:1], inner, corners[-1:]))

        def residual(inner: FloatArray) -> FloatArray:
            at = joined(inner)
            return self.weight * (np.interp(self.time, at, self.fitted(at)[0]) - self.values)

        def jacobian(inner: FloatArray) -> FloatArray:
            at = joined(inner)
            columns = self.derivatives(at, self.fitted(at)[0])
            linear, own = columns[:, : at.size], columns[:, at.size :]
            # Golub and Pereyra, after Kaufman.
            return own - linear @ np.linalg.lstsq(linear, own, rcond=None)[0]

        for _ in range(3):  # each may go half the way to its neighbours
            inner, steps = corners[1:-1], ROOM * np.diff(corners)
            bounds = inner - steps[:-1], inner + steps[1:]
            scale = np.minimum(steps[:-1], steps[1:])
            moved = joined(least_squares(residual, inner, jac=jacobian, bounds=bounds, x_scale=scale).x)
            settled = bool((np.abs(moved - corners)[1:-1] < 0.5 * scale).all())
            corners = moved
            if settled:
                break
        return corners

    def derivatives(self, corners: FloatArray, values: FloatArray) -> FloatArray:
        """Return the weighted derivatives of `straight_derivatives`."""
        return np.asarray(
            self.weight[:, np.newaxis] * straight_derivatives(self.time, corners, values), dtype=float
        )

    def fitted(self, corners: FloatArray) -> tuple[FloatArray, float]:
        """Return the values at the corners by least squares over all rows, and the sum of squares."""
        from scipy.linalg import solveh_banded

        values = np.asarray(solveh_banded(*self.normal(corners)))
        away = self.weight * (self.values - np.interp(self.time, corners, values))
        return values, float(np.sum(away**2))

    def normal(self, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrix of the values at corners, its two upper diagonals, and its right side."""
        piece = np.clip(np.searchsorted(corners, self.time, side="right") - 1, 0, corners.size - 2)
        right = (self.time - corners[piece]) / (corners[piece + 1] - corners[piece])
        left, weight = 1 - right, self.weight**2
        banded = np.zeros((2, corners.size))
        np.add.at(banded[1], piece, weight * left**2)
        np.add.at(banded[1], piece + 1, weight * right**2)
        np.add.at(banded[0], piece + 1, weight * left * right)
        moment = np.zeros(corners.size)
        np.add.at(moment, piece, weight * left * self.values)
        np.add.at(moment, piece + 1, weight * right * self.values)
        return banded, moment


def straight_derivatives(time: FloatArray, corners: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivatives of straight pieces to the values at corners, and to the times of inner ones."""
    piece = np.clip(np.searchsorted(corners, time, side="right") - 1, 0, corners.size - 2)
    slope = (np.diff(values) / np.diff(corners))[piece]
    right = (time - corners[piece]) / (corners[piece + 1] - corners[piece])
    columns = np.zeros((time.size, corners.size))
    rows = np.arange(time.size)
    columns[rows, piece], columns[rows, piece + 1] = 1 - right, right
    return np.hstack((columns, -slope[:, np.newaxis] * columns[:, 1:-1]))


# Inputs of a prediction of a curve: body and indenter, corrections of its columns, straight pieces.


class Correction(NamedTuple):
    """Values of a curve that correct its columns, and the adhesion under its indenter."""

    contact_point: float = 0.0
    drift: float = 0.0
    force_offset: float = 0.0
    force_drift: float = 0.0
    tilt: float = 0.0
    stiffness: float = math.inf
    adhesion: EdgeAdhesion = EdgeAdhesion()


OF_A_CURVE = Correction._fields[:-1]


def baseline(curve: ForceCurve, at: Correction) -> FloatArray:
    """Return the force that a curve has without contact, at its rows."""
    position = curve.position_of_drive
    since = curve.time - curve.time[0]
    return np.asarray(at.force_offset + at.force_drift * since + at.tilt * (position - position[0]))


@dataclass(frozen=True)
class Setup:
    """A body and its indenter."""

    body: Body
    profile: Revolution

    @cached_property
    def onset(self) -> float:
        """Power of the depth with which the force begins."""
        return onset(self.profile)


def onset(profile: Revolution) -> float:
    """Return the power of the depth with which the force begins: 1 + 1/n for a profile r^n, 1 for a flat."""
    small = 1e-6 * (profile.rim if math.isfinite(profile.rim) else 1.0)
    near, far = abel_transform(profile, small), abel_transform(profile, 2 * small)
    return 1.0 if far == 0 else 1 + 1 / math.log2(far / near)


class Pieces(NamedTuple):
    """The prescribed quantity, without its corrections, in pieces that are straight in time."""

    begin: FloatArray  # times at which the pieces begin and end, shape (pieces,)
    end: FloatArray
    first: FloatArray  # values there
    last: FloatArray
    by_force: BoolArray
    breakpoints: FloatArray  # times between which the response is smooth

    def at(self, times: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the values at times, of the pieces that end there or later, and whether they are forces."""
        piece = np.clip(np.searchsorted(self.end, times), 0, self.end.size - 1)
        part = (times - self.begin[piece]) / (self.end[piece] - self.begin[piece])
        return self.first[piece] + part * (self.last[piece] - self.first[piece]), self.by_force[piece]

    def largest(self, by_force: bool) -> float:
        """Return the largest prescribed force or position; -inf if none is prescribed."""
        own = self.by_force == by_force
        return float(np.concatenate((self.first[own], self.last[own])).max(initial=-math.inf))

    @property
    def first_contact(self) -> tuple[int, float]:
        """The piece in which the value first becomes positive, and the time; the end if none does."""
        if self.first[0] >= 0:
            return 0, float(self.begin[0])
        # A corner at first contact is zero but for rounding: its piece ends before.
        rising = np.flatnonzero(self.last > 1e-12 * np.abs(self.last).max())
        if not rising.size:
            return self.end.size - 1, float(self.end[-1])
        piece = int(rising[0])
        part = max(-self.first[piece] / (self.last[piece] - self.first[piece]), 0.0)
        return piece, float(self.begin[piece] + part * (self.end[piece] - self.begin[piece]))


COLUMNS = ("time", "depth", "force")  # the base may replace the depth


def numbers_in(data: Any, at: str = "") -> Iterator[tuple[str, float]]:
    """Yield the dotted keys of all numbers of the layers, the halfspace and the punch."""
    items: Any = enumerate(data) if isinstance(data, (list, tuple)) else data.items()
    for key, value in items:
        place = f"{at}[{key}]" if isinstance(key, int) else f"{at}.{key}".lstrip(".")
        if isinstance(value, (Mapping, list, tuple)):
            if at or key in {"layer", "layers", "halfspace", "punch", "adhesion"}:
                yield from numbers_in(value, place)
        elif at and isinstance(value, (int, float)) and not isinstance(value, bool):
            yield place, float(value)
