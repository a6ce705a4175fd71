"""Estimates of the parameters of a fit, their confidence intervals, and doubts about them.

Linear intervals: with the derivatives J of the residuals and their variance s^2, the covariance of u is
s^2 (J^T J)^-1 under white noise. A robust loss rho changes the factor to mean(psi^2)/mean(psi')^2,
psi = r rho'(r^2) (Huber, Robust Statistics, 1981, Sec. 7.6). Residuals of instruments are correlated: the
intervals are those of `intervals.mixture`. A standard error is the half width over Student's t.

Profile intervals: one parameter is fixed and all others are fitted again; at the ends of the interval the sum
of squares has grown by s^2 t^2 (Bates & Watts, Nonlinear Regression Analysis, 1988, Sec. 6.1), where t is
larger by the factor of the linear half widths under correlated noise. A further stiff residual fixes the
parameter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.elastic import CHOOSE, KINDS, NO_ADHESION
from gfmdlayer.fitting.force_curve import FORCE, CurveError, ForceCurve, noise_of
from gfmdlayer.fitting.intervals import mixture
from gfmdlayer.fitting.misfit import WITHIN, doubts, found_shapes
from gfmdlayer.fitting.problem import FreeParameter, LeastSquares
from gfmdlayer.fitting.result import ESTIMATORS, CurveFit, Estimate, FitOptions, IndentationFit

BAND = 0.95  # confidence of all intervals
OPEN = 10.0  # ratio of the ends of an interval from which a parameter is not determined
ADHESIONS = (NO_ADHESION, *KINDS, CHOOSE)
LOSSES = ("linear", "soft_l1", "huber", "cauchy")
NOTHING = 1e-100  # derivative to a parameter on which nothing depends: its square has an inverse
STIFF = 1e3  # of the further residual, over its standard error
ROUNDS = 5  # of the search for an end of a profile
CLOSE = 0.02  # an end is found when the root of the growth is this close to t, relative to t
BENT = 1.3  # times t: growth of the root of the squares at the ends of linear intervals that are rough
FAR = 4.0  # the search ends this many linear half-widths from the estimate


def conclude(
    problem: LeastSquares, u: FloatArray, options: FitOptions, notes: list[str], start: Mapping[str, float],
    *, measured: bool = True,
) -> IndentationFit:  # fmt: skip
    """Return the fit at u: estimates, intervals, correlations, information criteria, warnings.

    Planned curves, which are not `measured`, have no residuals; their noise is white.
    """
    residuals, jacobian = problem.residuals(u), problem.jacobian(u)
    known = problem.noise_is_known
    factor = variance(residuals, u.size, options.loss, known)
    white = covariance(jacobian, factor)
    t = quantile(BAND, residuals.size - u.size)
    reported, slopes = problem.reported(u)
    every = np.vstack((np.eye(u.size), slopes))
    half, spread = t * np.sqrt(np.einsum("ia,ab,ib->i", every, white, every)), white
    wider = np.ones(u.size)
    if measured and np.mean(residuals[: problem.rows] ** 2) > WITHIN**2:
        psi, slope = loss_derivatives(residuals, options.loss)
        blocks = [rows for each in problem.predictions for rows in each.blocks]
        made = mixture(-psi / np.mean(slope), jacobian, blocks, level=BAND, along=every)
        correlated = np.maximum(made.half, half) if known else made.half
        wider, half = correlated[u.size :] / half[u.size :], correlated
        own = half[: u.size] / t / np.sqrt(np.diag(made.spread))
        spread = made.spread * np.outer(own, own)
    on_scale, errors = slopes @ spread @ slopes.T, half[u.size :] / t
    profiles: list[tuple[float, float] | None] = [None] * u.size
    if options.profile:
        search = _ProfileInterval(problem, u, white, factor, options.loss)
        ends = [t * each for each in wider]
        profiles = [(search.end(i, end, -1.0), search.end(i, end, 1.0)) for i, end in enumerate(ends)]
    values = problem.values(u)
    estimates = tuple(
        _estimate(parameter, values[parameter.name], (float(reported[i]), float(errors[i])), t, profiles[i])
        for i, parameter in enumerate(problem.parameters)
    )
    fitted = tuple(_curve_fits(problem, u, t * t * spread))
    widths = np.sqrt(np.diag(on_scale))
    correlation = on_scale / np.outer(widths, widths)
    notes += _doubts(estimates, correlation, factor if known else 1.0)
    shapes = found_shapes(problem, u, residuals, jacobian) if measured else []
    doubtful = list(doubts(problem, u, residuals, shapes, float(np.median(wider)))) if measured else []
    if shapes:
        fitted = tuple(replace(each, missing=rows) for each, rows in zip(fitted, shapes[0].rows, strict=True))
    if problem.model.adhesion is not None and not problem.is_elastic and not options.profile:
        notes += _bent(problem, u, residuals, white, t, factor)
    twice, count = _deviance(problem, u, fitted, residuals[problem.rows :])
    independent = min(float(np.mean(wider**-2.0)), 1.0)
    return IndentationFit(
        estimates, correlation, fitted, twice, count, problem.rows, independent, (*notes, *doubtful),
        problem.solutions, problem.config(u), start, options, problem.adhesion(u), tuple(doubtful),
        shape=shapes[0].name if shapes else "",
    )  # fmt: skip


def _bent(
    problem: LeastSquares, u: FloatArray, residuals: FloatArray, spread: FloatArray, t: float, factor: float
) -> Iterator[str]:
    """Yield a warning if the squares do not grow by t^2 to the ends of the widest axis of the 95 % region."""
    widths = np.sqrt(np.diag(spread))
    values, axes = np.linalg.eigh(spread / np.outer(widths, widths))
    along = widths * axes[:, -1] * values[-1] ** 0.5
    least, roots = float(np.sum(residuals**2)), []
    for side in (-t, t):
        grown = float(np.sum(problem.residuals(np.clip(u + side * along, *problem.bounds)) ** 2)) - least
        roots.append(math.sqrt(max(grown, 0.0) / factor) / t)
    worst = max(roots, key=lambda root: abs(math.log(max(root, 1e-9))))
    if not 1 / BENT < worst < BENT:
        yield (
            f"the intervals are rough: at their ends the residual grows {worst:.2g} times as much as they "
            "assume; profile intervals are better"
        )


def _estimate(
    parameter: FreeParameter,
    value: float,
    on_scale: tuple[float, float],
    t: float,
    profile: tuple[float, float] | None,
) -> Estimate:
    """Convert an estimate from the scale of the fit to its own units."""
    at, error = on_scale
    relative = parameter.scale == "logarithmic"

    def back(x: float) -> float:
        if not relative:
            return float(np.clip(x, *parameter.bounds))
        return float(np.clip(math.exp(min(x, 700.0)), *parameter.bounds))

    ends = back(at - t * error), back(at + t * error)
    of_profile = None if profile is None else (back(profile[0]), back(profile[1]))
    named = parameter.key, parameter.curve
    own = value * error if relative else error
    return Estimate(*named, value, own, ends, of_profile, parameter.bounds, relative)


def _curve_fits(problem: LeastSquares, u: FloatArray, spread: FloatArray) -> Iterator[CurveFit]:
    """Yield the curves with their predictions; `spread` is the square of the 95 % region of u."""
    derivatives = problem.derivatives(u)
    freedom = problem.rows / max(problem.rows - u.size, 1)
    for i, prediction in enumerate(problem.predictions):
        columns = np.stack(
            [np.broadcast_to(column[i], prediction.used.shape) for column in derivatives], axis=1
        )
        band = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", columns, spread, columns), 0.0))
        force, depth = prediction.in_columns(*problem.at(u, prediction))
        fit = CurveFit(
            prediction.curve,
            force,
            depth,
            band,
            prediction.used & ~prediction.touch.uncertain,
            math.nan,
            math.nan,
        )
        noise = []
        for k, known in enumerate((prediction.curve.noise, prediction.curve.depth_noise)):
            rows = fit.used & (prediction.curve.by_force == bool(k))
            own = math.sqrt(freedom * float(np.mean(fit.residual[rows] ** 2))) if rows.any() else math.nan
            noise.append(float(known) if known is not None and rows.any() else own)
        yield replace(fit, noise=noise[0], depth_noise=noise[1])


def _deviance(
    problem: LeastSquares, u: FloatArray, fitted: Sequence[CurveFit], further: FloatArray
) -> tuple[float, int]:
    """Return -2 ln of the likelihood, and the number of parameters; `further`: residuals beside rows."""
    twice, count, uncorrelated = float(np.sum(further**2)), u.size, problem.rows_over_noise(u)
    for i, fit in enumerate(fitted):
        twice += problem.log_determinant(i) + problem.predictions[i].touch.doubt
        for k, is_given in enumerate(problem.noise_is_given(i)):
            own = fit.curve.by_force == bool(k)
            # Rows that count with one adhesion and not with another have the mean square of the others.
            rows, size = fit.used & own, int((problem.predictions[i].used & own).sum())
            noise = float(problem.noise[i, k])
            square = noise**2 * float(np.mean(uncorrelated[i][rows] ** 2)) if rows.any() else math.nan
            square = max(square, 1e-300)
            if not is_given:
                twice += size * (math.log(2 * math.pi * square) + 1)
                count += 1
            elif size:
                twice += size * (math.log(2 * math.pi * noise**2) + square / noise**2)
    return twice, count


def best_of(fits: Mapping[str, IndentationFit]) -> tuple[str, dict[str, float]]:
    """Return the best of several fits of the same curves, and the information criterion of each.

    Independent are the rows that are so under the fit with the smallest residuals.
    """
    part = min(fits.values(), key=lambda fit: fit.deviance).independent
    criteria = {name: fit.criterion(part) for name, fit in fits.items()}
    return min(criteria, key=lambda name: criteria[name]), criteria


def _doubts(estimates: Sequence[Estimate], correlation: FloatArray, excess: float) -> Iterator[str]:
    """Yield warnings: parameters that the data do not determine, and a noise that is not the given one."""
    for estimate in estimates:
        (low, high), (least, most) = estimate.profile or estimate.interval, estimate.bounds
        below, above = low <= least * (1 + 1e-6 * np.sign(least)), high >= most * (1 - 1e-6 * np.sign(most))
        if below and above:
            yield (
                f"{estimate.name}: the data do not determine it; its interval spans its bounds, {least:g} to "
                f"{most:g}"
            )
        elif below or above:
            side, bound = ("an upper", least) if below else ("a lower", most)
            yield f"{estimate.name}: the data give only {side} limit; the interval reaches {bound:g}"
        elif estimate.is_open:
            factor = f"{high / low:.2g}"
            yield f"{estimate.name}: the data hardly determine it; the interval spans a factor {factor}"
    for i, j in combinations(range(len(estimates)), 2):
        if abs(correlation[i, j]) > 0.99:
            pair = f"{estimates[i].name} and {estimates[j].name}"
            value = f"correlation {correlation[i, j]:.4f}"
            yield f"{pair}: the data determine only a combination of them ({value})"
    if excess > 1.5:
        yield f"the residual is {excess**0.5:.3g} times the given noise; the intervals account for it"


# The contact point of a measured curve, from the force.
#
# Up to the largest depth the force is a straight baseline before contact, and the baseline plus
# c (d - d_0)^m after it: m = 3/2 for a sphere, 2 for a cone, 1 for a flat end. For a given contact point, the
# baseline and c follow from a linear problem. The sum of squares is least at the true contact point, and
# larger by the variance of the noise at one standard error from it. Only the rows up to `PART` of the
# largest force count: deeper, a thin layer stiffens and a material relaxes. They end where the force,
# averaged over as many rows as its noise needs, rises through this level for the last time.

PART = 0.25  # of the largest force
BASELINE = 5  # rows before the contact, at least
CANDIDATES = 200
LONGEST = 10  # part of the rows over which a force is averaged, at most: one over this


class ContactPoint(NamedTuple):
    """The measured depth at which the indenter touches, its standard error, and the baseline of the force."""

    depth: float
    error: float
    offset: float  # force at the contact point without contact
    slope: float = 0.0  # of the baseline over the depth


def detect(curve: ForceCurve, exponent: float = 1.5) -> ContactPoint:
    """Find the contact point of a curve; the force grows with the power `exponent` of the depth.

    Where the force is prescribed from the first row on, contact begins with it.
    """
    if curve.segments[0].prescribed == FORCE:
        least = 3 * noise_of(curve.force) + 0.01 * float(np.max(curve.force))
        row = max(int(np.argmax(curve.force > least)) - 1, 0)
        return ContactPoint(float(curve.depth[row]), noise_of(curve.depth), 0.0)
    return _by_least_squares(curve, approach(curve), exponent, tilted=True)


def _by_least_squares(curve: ForceCurve, end: int, exponent: float, *, tilted: bool) -> ContactPoint:
    """Find the contact point of a baseline, constant or tilted, and a power of the depth below the point."""
    depth, force = curve.depth[:end], curve.force[:end]
    last = end - BASELINE
    if last <= BASELINE:
        raise CurveError(
            f"curve {curve.name}: only {end} rows up to {PART:.0%} of the largest force; a contact point "
            f"needs {BASELINE} rows before contact and {BASELINE} after it"
        )
    points = np.unique(np.linspace(depth[0], depth[last], CANDIDATES))
    found = [_squares(point, depth, force, exponent, tilted=tilted) for point in points]
    squares = np.array([each[0] for each in found])
    best = int(np.argmin(squares))
    if np.count_nonzero(depth < points[best]) < BASELINE:
        raise CurveError(
            f"curve {curve.name}: the first rows are already in contact; a contact point needs {BASELINE} "
            "rows before contact"
        )
    allowed = squares[best] * (1 + 1 / (end - 3 - tilted))
    inside = points[squares <= allowed]
    error = max(float(np.ptp(inside)) / 2, float(points[1] - points[0]))
    return ContactPoint(float(points[best]), error, *found[best][1:])


def approach(curve: ForceCurve) -> int:
    """Return the number of rows up to `PART` of the largest force, above a straight baseline."""
    force = _averaged(curve.force)
    end, deepest = int(np.argmax(force)) + 1, int(np.argmax(curve.position_of_drive)) + 1
    falling = _falling(curve, deepest) if end < deepest // 2 else None
    end = end if falling is None else deepest
    early = slice(0, max(BASELINE, end // 20))
    position = curve.position_of_drive[:end]
    line = np.full(end, np.median(curve.force[early])) if falling is None else falling(position)
    for _ in range(3):  # a tilted baseline: the rows before the level found first
        above = force[:end] - line
        low = np.flatnonzero(above <= PART * above[-1])
        if not low.size:
            return end
        before = position[: low[-1] + 1]
        half = before <= (before[0] + before[-1]) / 2
        if np.count_nonzero(half) < BASELINE or not np.ptp(before[half]) > 0:
            break
        line = np.polynomial.Polynomial.fit(before[half], curve.force[: before.size][half], 1)(position)
    return min(int(low[-1]) + 2, end)


def _falling(curve: ForceCurve, deepest: int) -> np.polynomial.Polynomial | None:
    """Return the line of a baseline that falls by more than the contact rises; None where none falls."""
    tenth = deepest // 10
    parts = [slice(0, tenth), slice(tenth, 2 * tenth)]
    force, position = (
        [np.median(each[part]) for part in parts] for each in (curve.force, curve.position_of_drive)
    )
    if tenth < BASELINE or force[0] - force[1] <= 4 * noise_of(curve.force) / math.sqrt(tenth):
        return None
    return np.polynomial.Polynomial.fit(position, force, 1) if position[1] > position[0] else None


def _averaged(force: FloatArray) -> FloatArray:
    """Return a force averaged over so many rows that four times its noise is below `PART` of its range."""
    rows = math.ceil((4 * noise_of(force) / max(PART * float(np.ptp(force)), 1e-300)) ** 2)
    rows = min(max(rows, 1), max(force.size // LONGEST, 1)) // 2 * 2 + 1
    return _moving(force, rows)


def _moving(values: FloatArray, rows: int) -> FloatArray:
    """Return averages over an odd number of rows around each."""
    return np.convolve(np.pad(values, rows // 2, mode="edge"), np.full(rows, 1 / rows), mode="valid")


def _squares(
    point: float, depth: FloatArray, force: FloatArray, exponent: float, *, tilted: bool
) -> tuple[float, float, float]:
    """Return the sum of squares for a contact point, and offset and slope of the baseline there."""
    shape, span = np.maximum(depth - point, 0.0) ** exponent, max(float(np.ptp(depth)), 1e-300)
    line = [(depth - point) / span] if tilted else []
    columns = np.stack([np.ones_like(shape), *line, shape / max(float(shape.max()), 1e-300)], axis=1)
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    rest = force - columns @ solution
    return float(rest @ rest), float(solution[0]), float(solution[1]) / span if tilted else 0.0


# What users do by hand before a fit, as nanite does it (`nanite.poc`): estimators of the contact point, the
# baseline of the rows before it, weights and ranges relative to it.

EARLY = 10  # rows of the approach over this: the baseline of `_deviating`
FLAT, AVERAGED = 0.01, 100  # of the largest gradient: no contact; rows over this are averaged
FEWEST_AVERAGED, RESERVE = 5, 10  # rows


def contact_point(curve: ForceCurve, method: str) -> ContactPoint:
    """Find the contact point of a curve by a method of `result.CONTACTS`; `detect` for given ones."""
    end = int(np.argmax(curve.force)) + 1
    match method:
        case "deviation":
            return _at_row(curve, _deviating(curve.force[:end]))
        case "gradient":
            return _at_row(curve, _rising(curve.force[:end]))
        case "constant_line":
            return _by_least_squares(curve, end, 1.0, tilted=False)
        case "constant_polynomial":
            return _by_polynomial(curve, end, tilted=False)
        case "line_polynomial":
            return _by_polynomial(curve, end, tilted=True)
        case _:
            return detect(curve)


def _deviating(force: FloatArray) -> int:
    """Return the first row beyond twice the largest deviation of the baseline from its mean."""
    early = force[: max(force.size // EARLY, BASELINE)]
    return int(np.argmax(force - early.mean() > 2 * float(np.abs(early - early.mean()).max())))


def _rising(force: FloatArray) -> int:
    """Return the last row at which the averaged gradient is flat, shifted as by one-sided averages."""
    rows = max(FEWEST_AVERAGED, force.size // AVERAGED) // 2 * 2 + 1
    gradient = _moving(np.gradient(_moving(force, rows))[: -RESERVE - 1], rows)
    flat = np.flatnonzero(gradient <= FLAT * float(gradient.max(initial=0.0)))
    return min(int(flat[-1]) + 1 + rows, force.size - 1) if flat.size else 0


def _by_polynomial(curve: ForceCurve, end: int, *, tilted: bool) -> ContactPoint:
    """Fit a constant or a line, and beyond the contact point x^3/(a x^2 + b x + c) too."""
    depth, force = curve.depth[:end], curve.force[:end]
    spans = float(np.ptp(depth)) or 1.0, float(np.ptp(force)) or 1.0
    x, y = (depth - depth[0]) / spans[0], (force - force.min()) / spans[1]

    def residuals(p: FloatArray) -> FloatArray:
        below = np.maximum(x - p[0], 0.0)
        a, b, c = np.exp(p[3:])
        line = p[1] + (p[2] * (x - p[0]) if tilted else 0.0)
        return np.asarray(line + below**3 / (a * below**2 + b * below + c) - y)

    first = float(x[int(np.argmin(y - x))])  # farthest below the straight line between both ends
    start = np.array([first, y[: max(end // EARLY, 1)].mean(), 0.0, *np.log([1 - first + 1e-3, 0.1, 0.01])])
    low, high = np.array([-0.5, -2, -9, -20, -20, -20.0]), np.array([1.5, 2, 9, 9, 9, 9.0])
    found = least_squares(
        residuals, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), x_scale="jac"
    ).x
    point = float(depth[0] + found[0] * spans[0])
    _at_row(curve, int(np.count_nonzero(depth < point)))
    slope = float(found[2]) * spans[1] / spans[0] if tilted else 0.0
    return ContactPoint(point, spans[0] / end, float(force.min() + found[1] * spans[1]), slope)


def _at_row(curve: ForceCurve, row: int) -> ContactPoint:
    if row < BASELINE:
        raise CurveError(
            f"curve {curve.name}: the first rows are already in contact; a contact point needs {BASELINE} "
            "rows before contact"
        )
    spacing = abs(float(curve.depth[row] - curve.depth[row - 1]))
    return ContactPoint(float(curve.depth[row]), spacing, float(curve.force[:row].mean()))


def prepared(curve: ForceCurve, options: FitOptions, settled: bool) -> ForceCurve:
    """Return a curve without baseline, with weights, and with depths from a contact point that is `settled`.

    What was done is in its origin.
    """
    estimated = options.contact in ESTIMATORS
    relative = options.weight is not None or options.range is not None
    if not (estimated or options.baseline != "none" or (relative and options.contact != "given")):
        point = ContactPoint(0.0, 0.0, 0.0)  # as the depths are given
        done: dict[str, Any] = {}
    else:
        point = contact_point(curve, options.contact)
        done = {"contact": options.contact, "contact_point": point.depth}
    depth, force = curve.depth, curve.force
    if options.baseline != "none":
        before = np.arange(force.size) < int(np.argmax(depth > point.depth))
        position = curve.position_of_drive
        line = np.polynomial.Polynomial.fit(position[before], force[before], int(options.baseline == "tilt"))
        force = force - line(position)
        done |= {"baseline": options.baseline, "coefficients": line.convert().coef.tolist()}
    below, weights = depth - point.depth, np.ones(depth.size)
    if options.weight is not None:
        weights = np.clip(np.abs(below) / options.weight, 0.0, 1.0)
        done |= {"weight": options.weight}
    if options.range is not None:
        low, high = options.range
        weights[(below < low) | (below > high)] = 0.0
        done |= {"range": list(options.range)}
    if estimated and settled:
        depth = below
    if not done:
        return curve
    given = 1.0 if curve.weights is None else curve.weights
    account = "; ".join(f"{key}: {value}" for key, value in done.items())
    said = "; ".join(filter(None, (str(curve.origin.get("account", "")), account)))
    origin = {**curve.origin, "prepared": done, "account": said}
    return replace(
        curve, depth=depth, force=force, weights=given * weights if relative else curve.weights, origin=origin
    )


def loss_derivatives(residuals: FloatArray, loss: str) -> tuple[FloatArray, FloatArray]:
    """Return psi = r rho'(r^2) and its derivative to r, for the losses of `scipy.optimize.least_squares`."""
    z = residuals**2
    match loss:
        case "soft_l1":
            first, second = (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5
        case "huber":
            outside = np.maximum(z, 1.0)
            first = outside**-0.5
            second = np.where(z > 1, -0.5 * outside**-1.5, 0.0)
        case "cauchy":
            first, second = 1 / (1 + z), -1 / (1 + z) ** 2
        case _:
            first, second = np.ones_like(z), np.zeros_like(z)
    return residuals * first, first + 2 * z * second


def variance(residuals: FloatArray, parameters: int, loss: str, known: bool) -> float:
    """Return the factor of (J^T J)^-1 in the covariance; at least 1 where the noise is `known`."""
    psi, slope = loss_derivatives(residuals, loss)
    found = float(np.sum(psi**2) / (residuals.size - parameters) / np.mean(slope) ** 2)
    return max(found, 1.0) if known else found


def covariance(jacobian: FloatArray, factor: float) -> FloatArray:
    """Return factor (J^T J)^-1; directions that the data do not determine get a huge variance."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = NOTHING
    _, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    inverse = np.maximum(singular, 1e-12 * (singular.max() or 1.0)) ** -2.0
    return np.asarray(factor * (directions.T * inverse) @ directions / np.outer(scale, scale))


def quantile(level: float, freedom: int) -> float:
    """Student's t for a two-sided interval."""
    return float(stdtrit(freedom, 0.5 + level / 2))


class _ProfileInterval:
    """The ends of the profile intervals."""

    def __init__(
        self, problem: LeastSquares, best: FloatArray, spread: FloatArray, factor: float, loss: str
    ) -> None:
        self._problem, self._best, self._spread, self._factor = problem, best, spread, factor
        self._loss = loss
        self._least = float(np.sum(problem.residuals(best) ** 2))

    def end(self, i: int, t: float, side: float) -> float:
        """Return the lower (side -1) or upper (+1) end of parameter i on its scale; infinite if not found."""
        best, slopes = self._problem.reported(self._best)
        error = float(np.sqrt(slopes[i] @ self._spread @ slopes[i]))
        direction = self._spread @ slopes[i] / error**2
        reach, u = t * error, self._best
        known = [(0.0, 0.0)]  # distances from the estimate, and the roots there
        for _ in range(ROUNDS):
            moved = side * (reach - known[-1][0])
            u = self._fixed_at(i, best[i] + side * reach, error, u + moved * direction)
            known.append((reach, self._root(u)))
            (near, low), (far, root) = known[-2:]
            if abs(root - t) < CLOSE * t:
                break
            pace = max((root - low) / (far - near), 0.1 * t / reach)
            reach = float(np.clip(far + (t - root) / pace, 0.3 * far, 2 * far))
            if reach > FAR * t * error:
                return side * np.inf
        return float(best[i] + side * reach)

    def _root(self, u: FloatArray) -> float:
        grown = float(np.sum(self._problem.residuals(u) ** 2)) - self._least
        return float(np.sqrt(max(grown, 0.0) / self._factor))

    def _fixed_at(self, i: int, value: float, error: float, start: FloatArray) -> FloatArray:
        """Fit the other parameters with parameter i fixed."""
        stiffness = STIFF * self._factor**0.5 / error

        def residuals(u: FloatArray) -> FloatArray:
            return np.append(
                self._problem.residuals(u), stiffness * (self._problem.reported(u)[0][i] - value)
            )

        def jacobian(u: FloatArray) -> FloatArray:
            return np.vstack([self._problem.jacobian(u), stiffness * self._problem.reported(u)[1][i]])

        return minimised(residuals, jacobian, start, self._problem.bounds, self._loss, 1e-4)


def minimised(
    residuals: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    loss: str = "linear",
    precision: float = 1e-7,
) -> FloatArray:
    """Return the u of least loss within bounds."""
    room = 1e-9 * (bounds[1] - bounds[0])
    inside = np.clip(start, bounds[0] + room, bounds[1] - room)
    found = least_squares(
        residuals, inside, jac=jacobian, bounds=bounds, x_scale="jac", loss=loss,
        ftol=precision, xtol=precision, gtol=1e-12, max_nfev=150,
    )  # fmt: skip
    return np.asarray(found.x)
