"""Estimates of the parameters of a fit, with their errors, and what the data cannot tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.fitting.indentation import intervals
from gfmdlayer.fitting.indentation.curve import CurveError, ForceCurve
from gfmdlayer.fitting.indentation.parameters import Parameter
from gfmdlayer.fitting.indentation.problem import LeastSquares

BAND = 0.95  # confidence of all intervals


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    key: str  # dotted key of the model or value of a curve, and the curve if it belongs to one of several
    curve: str  # dotted key of the model or value of a curve, and the curve if it belongs to one of several
    value: float  # value of least squares
    error: float  # standard error; relative where the parameter is fitted by its logarithm
    interval: tuple[float, float]  # 95 % confidence interval, linear
    profile: tuple[float, float] | None  # 95 % confidence interval of the profile
    bounds: tuple[float, float]  # those of the fit
    relative: bool  # whether it is fitted by its logarithm

    @property
    def name(self) -> str:
        """Key, with the curve to which it belongs."""
        return f"{self.key}[{self.curve}]" if self.curve else self.key

    @property
    def standard_error(self) -> float:
        """Standard error in the units of the value."""
        return self.value * self.error if self.relative else self.error


@dataclass(frozen=True)
class CurveFit:
    """A curve with the force of the fitted model."""

    curve: ForceCurve  # the measurement
    force: FloatArray  # predicted, at the rows of the curve
    band: FloatArray  # half width of the 95 % confidence band of the prediction
    noise: float  # standard deviation of the force, as given or from the residual


@dataclass(frozen=True)
class IndentationFit:
    """A fit of one or several curves."""

    parameters: tuple[Estimate, ...]  # the free parameters
    # shape (parameters, parameters); of the estimates, on the scales on which they are fitted
    correlation: FloatArray
    curves: tuple[CurveFit, ...]  # the curves
    # information criteria of Akaike and Schwarz for normal noise: smaller is better, for the same curves
    aic: float
    # information criteria of Akaike and Schwarz for normal noise: smaller is better, for the same curves
    bic: float
    warnings: tuple[str, ...]  # what the data cannot tell, and what is odd about them
    solutions: int  # contact problems over a whole curve that were solved
    config: Any = field(repr=False)  # the model with the fitted values

    @property
    def depth(self) -> float:
        """Largest depth below the contact point, of all curves."""
        points = {each.curve: each.value for each in self.parameters if each.key == "contact_point"}
        shared = points.get("", 0.0)
        reached = (float(fit.curve.depth.max()) - points.get(fit.curve.name, shared) for fit in self.curves)
        return max(*reached, 0.0)

    def __getitem__(self, name: str) -> Estimate:
        """Return a parameter by its key, or its last part."""
        for each in self.parameters:
            if name in {each.name, each.key, each.key.rpartition(".")[2]}:
                return each
        raise KeyError(f"{name}: must be one of {', '.join(each.name for each in self.parameters)}")


@dataclass(frozen=True)
class FitOptions:
    """How curves are fitted."""

    loss: str = "linear"  # linear, or soft_l1, huber, cauchy, which outliers pull less
    profile: bool = False  # find the profile intervals too; the fit then takes three to ten times as long
    # given: the depth is that below the surface. detect: each curve has a free contact point and offset of
    # the force, which start where the force begins to rise
    contact: str = "given"

    def __post_init__(self) -> None:
        problems = []
        if self.loss not in intervals.LOSSES:
            problems.append(f"loss: got {self.loss!r}; must be one of {', '.join(intervals.LOSSES)}")
        if self.contact not in {"given", "detect"}:
            problems.append(f"contact: got {self.contact!r}; must be given or detect")
        if problems:
            raise ConfigError(problems)


def conclude(problem: LeastSquares, u: FloatArray, options: FitOptions, notes: list[str]) -> IndentationFit:
    """Estimate the errors of a fit."""
    residuals, jacobian = problem.residuals(u), problem.jacobian(u)
    known = all(each.curve.noise is not None for each in problem.predictions)
    factor = intervals.variance(residuals, u.size, options.loss, known)
    spread = intervals.covariance(jacobian, factor)
    t = intervals.quantile(BAND, residuals.size - u.size)
    reported, slopes = problem.reported(u)
    on_scale = slopes @ spread @ slopes.T
    errors = np.sqrt(np.diag(on_scale))
    profiles: list[tuple[float, float] | None] = [None] * u.size
    if options.profile:
        refit = partial(_refit, bounds=problem.bounds, loss=options.loss)
        search = intervals.Profile(problem, u, spread, factor, refit)
        profiles = [search.interval(i, t) for i in range(u.size)]
    values = problem.values(u)
    estimates = tuple(
        _estimate(each, values[each.name], (float(reported[i]), float(errors[i])), t, profiles[i])
        for i, each in enumerate(problem.parameters)
    )
    band = t * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", jacobian, spread, jacobian), 0.0))
    fitted = tuple(_curve_fits(problem, u, band, residuals, known))
    correlation = on_scale / np.outer(errors, errors)
    notes += _doubts(estimates, correlation, fitted, factor if known else 1.0)
    aic, bic = _criteria(fitted, u.size)
    return IndentationFit(
        estimates, correlation, fitted, aic, bic, tuple(notes), problem.solutions, problem.config(u)
    )


def _refit(
    residuals: Any, jacobian: Any, start: FloatArray, bounds: tuple[FloatArray, FloatArray], loss: str
) -> FloatArray:
    return intervals.minimised(residuals, jacobian, start, bounds, loss, 1e-4)


def _estimate(
    parameter: Parameter,
    value: float,
    on_scale: tuple[float, float],
    t: float,
    profile: tuple[float, float] | None,
) -> Estimate:
    """Turn an estimate on its scale into one in its units."""
    at, error = on_scale
    relative = parameter.scale == "logarithmic"

    def back(x: float) -> float:
        if not relative:
            return float(np.clip(x, *parameter.bounds))
        return float(np.clip(math.exp(min(x, 700.0)), *parameter.bounds))

    ends = back(at - t * error), back(at + t * error)
    of_profile = None if profile is None else (back(profile[0]), back(profile[1]))
    return Estimate(
        parameter.key, parameter.curve, value, error, ends, of_profile, parameter.bounds, relative
    )


def _curve_fits(
    problem: LeastSquares, u: FloatArray, band: FloatArray, residuals: FloatArray, known: bool
) -> Iterator[CurveFit]:
    begin = 0
    freedom = residuals.size / max(residuals.size - u.size, 1)
    for force, each, noise in zip(problem.forces(u), problem.predictions, problem.noise, strict=True):
        rows = slice(begin, begin + force.size)
        begin = rows.stop
        own = float(np.sqrt(np.mean(residuals[rows] ** 2) * freedom)) * noise
        yield CurveFit(each.curve, force, band[rows] * noise, float(noise) if known else own)


def _criteria(fitted: Sequence[CurveFit], parameters: int) -> tuple[float, float]:
    """Return AIC and BIC; a noise that was estimated counts as a parameter."""
    twice, rows, count = 0.0, 0, parameters
    for each in fitted:
        squares, size = float(np.sum((each.force - each.curve.force) ** 2)), each.force.size
        if each.curve.noise is None:
            twice += size * (math.log(2 * math.pi * max(squares, 1e-300) / size) + 1)
            count += 1
        else:
            twice += size * math.log(2 * math.pi * each.noise**2) + squares / each.noise**2
        rows += size
    return twice + 2 * count, twice + count * math.log(rows)


def _doubts(
    estimates: Sequence[Estimate], correlation: FloatArray, fitted: Sequence[CurveFit], excess: float
) -> Iterator[str]:
    """Yield what the data cannot tell."""
    for each in estimates:
        (low, high), (least, most) = each.profile or each.interval, each.bounds
        below, above = low <= least * (1 + 1e-6 * np.sign(least)), high >= most * (1 - 1e-6 * np.sign(most))
        if below and above:
            yield (
                f"{each.name}: the data do not determine it: its interval spans its bounds, {least:g} to "
                f"{most:g}"
            )
        elif below or above:
            side, bound = ("above", least) if below else ("below", most)
            yield f"{each.name}: the data bound it from {side} only: its interval reaches the bound {bound:g}"
        elif each.relative and high > 10 * low:
            yield f"{each.name}: hardly determined: its interval spans a factor of {high / low:.2g}"
    for i, j in combinations(range(len(estimates)), 2):
        if abs(correlation[i, j]) > 0.99:
            pair = f"{estimates[i].name} and {estimates[j].name}"
            value = f"correlation {correlation[i, j]:.4f}"
            yield f"{pair}: {value}: the data determine a combination of them, not both"
    for fit in fitted:
        residual = fit.force - fit.curve.force
        if np.sum(residual**2) > 0:
            along = float(residual[1:] @ residual[:-1] / (residual @ residual))
            if along > 0.5:
                yield (
                    f"curve {fit.curve.name}: residuals of neighbouring rows have a correlation of "
                    f"{along:.2f}: the model does not describe the curve to its noise, and intervals are "
                    "too narrow"
                )
    if excess > 1.5:
        yield f"the residual is {excess**0.5:.3g} times the noise that was given; intervals count with it"


# The contact point of a measured curve, from the force alone.
#
# Up to the largest depth the force is an offset before the contact and an offset plus c (d - d_0)^m after it:
# m = 3/2 for a sphere, 2 for a cone, 1 for a flat end. For each row as the contact point, offset and c are a
# linear problem; the sum of squares over the rows has its minimum at the contact point, and grows by the
# variance of the noise at one standard error from it. Only the rows up to `PART` of the largest force count:
# further in, a thin layer stiffens, and a material relaxes.

PART = 0.25  # of the largest force
BASELINE = 5  # rows before the contact, at least
CANDIDATES = 200


class ContactPoint(NamedTuple):
    """A measured depth at which the indenter touches, its standard error, and the force before."""

    depth: float
    error: float
    offset: float


def detect(curve: ForceCurve, exponent: float = 1.5) -> ContactPoint:
    """Find the contact point of a curve."""
    end = int(np.argmax(curve.force)) + 1
    offset = float(np.median(curve.force[: max(BASELINE, end // 20)]))
    reached = np.flatnonzero(curve.force[:end] - offset > PART * (curve.force[end - 1] - offset))
    end = int(reached[0]) + 1 if reached.size else end
    depth, force = curve.depth[:end], curve.force[:end]
    last = end - BASELINE
    if last <= BASELINE:
        raise CurveError(
            f"curve {curve.name}: {end} rows up to {PART:.0%} of the largest force; a contact point needs "
            f"{BASELINE} rows before the contact and as many after it"
        )
    points = np.unique(np.linspace(depth[0], depth[last], CANDIDATES))
    found = [_squares(point, depth, force, exponent) for point in points]
    squares = np.array([each[0] for each in found])
    best = int(np.argmin(squares))
    if np.count_nonzero(depth < points[best]) < BASELINE:
        raise CurveError(
            f"curve {curve.name}: presses from its first rows on; a contact point needs {BASELINE} rows "
            "before the contact"
        )
    allowed = squares[best] * (1 + 1 / (end - 3))
    inside = points[squares <= allowed]
    error = max(float(np.ptp(inside)) / 2, float(points[1] - points[0]))
    return ContactPoint(float(points[best]), error, found[best][1])


def _squares(point: float, depth: FloatArray, force: FloatArray, exponent: float) -> tuple[float, float]:
    """Return the sum of squares for a contact point, and the offset."""
    shape = np.maximum(depth - point, 0.0) ** exponent
    columns = np.stack([np.ones_like(shape), shape / max(float(shape.max()), 1e-300)], axis=1)
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.sum((force - columns @ solution) ** 2)), float(solution[0])
