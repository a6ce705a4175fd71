"""Fits of material laws to measured curves: Prony series, and laws with a continuous spectrum.

The series has the fewest branches whose error is close to the least of any series.

    G(t) = G0 + sum_k G_k exp(-t/tau_k),     G0 > 0, G_k > 0                Eq. (5) for many branches

of Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68, is fitted in the relative error: every
residual is divided by the measured modulus, and every row counts the same.

The least error of any series comes first: with the relaxation times on a dense grid the moduli follow from a
convex problem, non-negative least squares. Then branches are added one at a time, each where it reduces the
error fastest, and after each addition all times move to the minimum of the error: the alternating descent
conditional gradient method of Boyd, Schiebinger & Recht, SIAM J. Optim. 27 (2017) 616-639. The moduli follow
the times by non-negative least squares (variable projection, Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973)
413-432, with the Jacobian of Kaufman, BIT 15 (1975) 49-57).

There are enough branches when the error is within `MARGIN` of the least, or below `ACCURACY`, which is better
than the accuracy of measured moduli. The margin gives up sqrt(1.05^2 - 1), a third, of the noise; the
Bayesian information criterion would set it to 3 % for 80 rows of a master curve.

The times lie in the measured range and half a decade to either side. A slower branch looks like the relaxed
modulus, a faster one like a dashpot. If the fitted G0 is a small part of the lowest measured modulus, the
material is a liquid or the curve ends far too early, and the fit is rejected unless G0 = 0 is given.

A creep curve is fitted in the same way by retarded compliances at retardation times, with a flow t/eta where
the curve shows one, and the series of relaxation times follows exactly (`measurement.CreepCurve`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product

import numpy as np
from scipy.optimize import least_squares, nnls
from scipy.special import expit, logit

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.materials import Law, Prony
from gfmdlayer.fitting.measurement import CreepCurve, FitError, Measurement

MARGIN = 1.05
ACCURACY = 2e-3
INSTANT = ACCURACY / 2  # of the least measured compliance: the least instantaneous one
EXACT = 1e-6  # relative error below the written digits
FLOWING = 0.1  # of the lowest measured modulus
STALLED = 0.9999  # of the previous error: another branch does not help
MOST_BRANCHES = 50
BEYOND = math.log(10) / 2  # of the measured range, in the logarithm of time
SPACING = math.log(10) / 20  # of the dense grid
# Two branches closer than this respond as one within (log(1.1)/2)^2/2 = 0.1 %, half the accuracy.
NEIGHBOURS = math.log(1.1)


@dataclass(frozen=True)
class FittedLaw:
    """A fitted series."""

    measurement: Measurement  # the measured curve
    material: Law  # the fitted law; branches of a series from the fastest to the slowest
    least: float  # least rms error of any series with times in the range

    @property
    def errors(self) -> FloatArray:
        """Fitted over measured, minus one, in the shape of the measured moduli."""
        predicted = self.measurement.predicted(self.material, self.measurement.abscissa)
        return predicted / self.measurement.moduli - 1

    @property
    def rms(self) -> float:
        """Root mean square of the relative errors."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def largest(self) -> float:
        """Largest magnitude of the relative errors."""
        return float(np.abs(self.errors).max())

    def normalised(self) -> FittedLaw:
        """The same fit with all moduli in units of G0, or of G for a power law without G0."""
        unit = self.material.unit
        return FittedLaw(self.measurement.in_units_of(unit), self.material.scaled(1 / unit), self.least)


def fit(measurement: Measurement, branches: int | None = None, relaxed: float | None = None) -> FittedLaw:
    """Fit a Prony series to a measured curve.

    `branches` is the number of branches (default: the fewest that are enough); there are fewer if more do not
    reduce the error. `relaxed` is G0 (default: fitted).
    """
    most = min(MOST_BRANCHES, (measurement.moduli.size - 1) // 2)
    if branches is not None and not 1 <= branches <= most:
        raise FitError(f"got {branches} branches; must be 1 to {most} for {measurement.abscissa.size} rows")
    check_relaxed(measurement, relaxed)
    if isinstance(measurement, CreepCurve):
        return _fit_creep(measurement, branches, flows=relaxed == 0 or None)
    problem = SeriesProblem(measurement, relaxed)
    least = problem.least
    enough = max(MARGIN * least, ACCURACY)
    times = problem.grown(branches or most, EXACT if branches else enough)
    if not times.size:
        raise _elastic(measurement)
    moduli = problem.moduli(times)
    if relaxed is None and moduli[0] < FLOWING * measurement.elastic.min():
        raise flows(measurement, float(moduli[0]))
    series = zip(moduli[1:].tolist(), np.exp(times).tolist(), strict=True)
    return FittedLaw(measurement, Prony(float(moduli[0]), tuple(series)), least)


def _fit_creep(curve: CreepCurve, branches: int | None, *, flows: bool | None) -> FittedLaw:
    """Fit retarded compliances, and a flow where the curve shows one or it is asked for."""
    problems = [
        SeriesProblem(curve, None, flows=each) for each in ((False, True) if flows is None else (True,))
    ]
    least = problems[-1].least
    # A solid whose creep ends beyond the data looks like a liquid: a flow must improve the fit.
    problem = problems[0] if problems[0].least <= max(MARGIN * least, ACCURACY) else problems[-1]
    enough = max(MARGIN * least, ACCURACY)
    most = min(MOST_BRANCHES, (curve.moduli.size - 1) // 2)
    times = problem.grown((branches or most) - problem.flows, EXACT if branches else enough)
    if not times.size and not problem.flows:
        raise _elastic(curve)
    instant, *flow = problem.moduli(times)[: problem.first].tolist()
    retarded = problem.moduli(times)[problem.first :]
    return FittedLaw(curve, curve.series(instant, sum(flow), retarded, np.exp(times)), least)


def _elastic(measurement: Measurement) -> FitError:
    return FitError(f"{measurement.source}: nothing relaxes in the measured range; use model: elastic")


def check_relaxed(measurement: Measurement, relaxed: float | None) -> None:
    """Reject a relaxed modulus that is not between 0 and the highest measured modulus."""
    highest = measurement.elastic.max()
    if relaxed is not None and not 0 <= relaxed < highest:
        allowed = f"must be > 0 and below the highest measured, {highest:.6g}, or 0 for a liquid"
        raise FitError(f"got the relaxed modulus {relaxed:g}; {allowed}")
    if relaxed and isinstance(measurement, CreepCurve):
        raise FitError(f"got the relaxed modulus {relaxed:g}; a creep curve has its own, or 0 for a liquid")


def flows(measurement: Measurement, relaxed: float) -> FitError:
    """Return the error for a curve that does not determine the relaxed modulus."""
    lowest = measurement.elastic.min()
    return FitError(
        f"{measurement.source}: the material flows like a liquid: the fitted G0 = {relaxed:.3g} is far below "
        f"the lowest measured modulus, {lowest:.3g}. For a solid, measure at {measurement.slower}, or give "
        "--relaxed-modulus; a liquid has --relaxed-modulus 0"
    )


@dataclass(frozen=True)
class SeriesProblem:
    """The least-squares problem in the moduli, G0 first, and the logarithms of the times.

    Of a creep curve: in the compliances, the instantaneous one and then that of the flow first.
    """

    measurement: Measurement
    relaxed: float | None
    flows: bool = False

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """The least and the largest logarithm of a time."""
        shortest, longest = self.measurement.reach
        return math.log(shortest) - BEYOND, math.log(longest) + BEYOND

    @cached_property
    def grid(self) -> FloatArray:
        """Logarithms of times, dense."""
        first, last = self.bounds
        return np.linspace(first, last, math.ceil((last - first) / SPACING) + 1)

    @property
    def least(self) -> float:
        """The least root mean square error of any series with times in the range."""
        return self.error(self.grid)

    @cached_property
    def directions(self) -> FloatArray:
        """Responses of the branches on the grid, of unit length."""
        columns = self.columns(self.grid)[:, self.first :]
        return np.asarray(columns / np.linalg.norm(columns, axis=0))

    def columns(self, times: FloatArray) -> FloatArray:
        """Responses of the spring, the flow and the branches, over the measured moduli."""
        curve = self.measurement
        flow = [curve.flow] if self.flows and isinstance(curve, CreepCurve) else []
        responses = np.column_stack([curve.constant, *flow, curve.response(np.exp(times))])
        return responses / curve.moduli.reshape(-1, 1)

    @property
    def first(self) -> int:
        """Number of the column of the first branch."""
        return 1 + self.flows

    @cached_property
    def stiffest(self) -> float:
        """The least instantaneous compliance of a creep curve, which a series must have."""
        return INSTANT * float(self.measurement.moduli.min()) * isinstance(self.measurement, CreepCurve)

    def moduli(self, times: FloatArray) -> FloatArray:
        """The moduli of least error."""
        columns = self.columns(times)
        if self.relaxed is None:
            found = _non_negative(columns, 1 - self.stiffest * columns[:, 0])
            found[0] += self.stiffest
            return found
        rest = _non_negative(columns[:, 1:], 1 - self.relaxed * columns[:, 0])
        return np.append(self.relaxed, rest)

    def residual(self, times: FloatArray) -> FloatArray:
        """Relative errors of the fit with these times."""
        return np.asarray(self.columns(times) @ self.moduli(times) - 1)

    def error(self, times: FloatArray) -> float:
        """Root mean square of the relative errors."""
        return float(np.sqrt(np.mean(self.residual(times) ** 2)))

    def jacobian(self, times: FloatArray) -> FloatArray:
        """Derivative of the residual by the times, projected since the moduli follow (Kaufman)."""
        moduli = self.moduli(times)
        free = moduli > 0
        free[0] &= self.relaxed is None and moduli[0] > self.stiffest
        slopes = self.measurement.sensitivity(np.exp(times)) * moduli[self.first :]
        slopes /= self.measurement.moduli.reshape(-1, 1)
        basis = np.linalg.qr(self.columns(times)[:, free]).Q
        return np.asarray(slopes - basis @ (basis.T @ slopes))

    def polished(self, times: FloatArray) -> FloatArray:
        """Return the times of least error nearby, sorted; zero and nearly coincident branches are removed."""
        moved = least_squares(self.residual, times, self.jacobian, self.bounds, xtol=1e-6, ftol=1e-8)
        kept = self._distinct(np.sort(moved.x))
        return kept if kept.size == times.size else self.polished(kept)

    def _distinct(self, times: FloatArray) -> FloatArray:
        moduli = self.moduli(times)[self.first :]
        times, moduli = times[moduli > 0], moduli[moduli > 0]
        close = np.flatnonzero(np.diff(times) < NEIGHBOURS)
        if not close.size:
            return times
        first = close[0]
        pair = slice(first, first + 2)
        merged = np.average(times[pair], weights=moduli[pair])
        return self._distinct(np.concatenate([times[:first], [merged], times[first + 2 :]]))

    def grown(self, most: int, enough: float) -> FloatArray:
        """Add branches until there are `most`, the error is below `enough`, or another does not help."""
        times, error = np.empty(0), self.error(np.empty(0))
        while times.size < most and error > enough:
            descent = -self.directions.T @ self.residual(times)
            more = self.polished(np.append(times, self.grid[descent.argmax()]))
            reduced = self.error(more)
            if reduced > STALLED * error:
                break
            times, error = more, reduced  # the new branch may have replaced another
        return times


def _non_negative(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Coefficients >= 0 of least squares, with columns scaled to unit length."""
    if not columns.size:
        return np.zeros(columns.shape[1])
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(nnls(columns / size, target, maxiter=100 * len(size))[0] / size)


# Fits of laws with a continuous spectrum to measured curves.
#
# The parameters minimise the squares of the relative errors of the moduli, as for the series,
# from several starts. Moduli and times enter by their logarithms and exponents by their logits, so no bound
# is needed.

EXPONENTS = (0.25, 0.5, 0.8)  # of the starts
BEST = 3  # starts that are refined by least squares
LIMIT = 30.0  # of the logarithms and logits
NO_SPRING = 1e-3  # of the lowest modulus: a weaker spring beside a springpot is left out


@dataclass(frozen=True)
class _Unknowns:
    """A law as a function of unbounded numbers, and starts for them."""

    law: Callable[[FloatArray], Law]  # from the numbers to the law
    starts: list[list[float]]


def fit_law(measurement: Measurement, model: str, relaxed: float | None = None) -> FittedLaw:
    """Fit the law MODELS[model] to a measured curve, with G0 = `relaxed` if given."""
    check_relaxed(measurement, relaxed)
    unknowns = MODELS[model](measurement, relaxed)
    wanted = measurement.moduli

    def residual(x: FloatArray) -> FloatArray:
        law = unknowns.law(x.clip(-LIMIT, LIMIT))
        return np.ravel(measurement.predicted(law, measurement.abscissa) / wanted - 1)

    starts = sorted(unknowns.starts, key=lambda start: float(np.sum(residual(np.array(start)) ** 2)))
    trials = [least_squares(residual, start, x_scale="jac") for start in starts[:BEST]]
    best = min(trials, key=lambda trial: trial.cost)
    law = unknowns.law(best.x.clip(-LIMIT, LIMIT))
    lowest = float(measurement.elastic.min())
    if relaxed is None and isinstance(law, PowerLaw) and 0 < law.G0 < NO_SPRING * lowest:
        return fit_law(measurement, model, 0.0)
    if relaxed is None and not isinstance(law, PowerLaw) and law.relaxed < FLOWING * lowest:
        raise flows(measurement, law.relaxed)
    creeps = isinstance(measurement, CreepCurve)
    return FittedLaw(measurement, law, SeriesProblem(measurement, relaxed or None, flows=creeps).least)


def _relaxing(
    law: Callable[..., Law], exponent: str, measurement: Measurement, relaxed: float | None
) -> _Unknowns:
    """Unknowns G0 (if not given), Ginf - G0, tau and an exponent."""
    elastic = measurement.elastic
    shortest, longest = np.log(measurement.reach)
    times = np.linspace(shortest, longest, 5)[1:4]

    def made(x: FloatArray) -> Law:
        *spring, difference, tau, shape = x.tolist()
        G0 = relaxed if relaxed is not None else unit * math.exp(spring[0])
        parameters = {"G0": G0, "Ginf": G0 + unit * math.exp(difference), "tau": math.exp(tau)}
        return law(**parameters, **{exponent: float(0.01 + 0.99 * expit(shape))})

    unit = float(elastic.max())
    spring = [] if relaxed is not None else [math.log(float(elastic.min()) / unit)]
    starts = [[*spring, 0.0, float(tau), float(logit(a))] for tau, a in product(times, EXPONENTS)]
    return _Unknowns(made, starts)


def _havriliak_negami(measurement: Measurement, relaxed: float | None) -> _Unknowns:
    """The same and the asymmetry, between 0 and 1/alpha."""
    symmetric = _relaxing(HavriliakNegami, "alpha", measurement, relaxed)

    def made(x: FloatArray) -> Law:
        law = symmetric.law(x[:-1])
        assert isinstance(law, HavriliakNegami)
        gamma = max(float(expit(x[-1])), 1e-3) / law.alpha
        skewed: Law = HavriliakNegami(law.G0, law.Ginf, law.tau, law.alpha, gamma)
        return skewed

    return _Unknowns(made, [[*start, 0.0] for start in symmetric.starts])


def _power_law(measurement: Measurement, relaxed: float | None) -> _Unknowns:
    """Unknowns G at the middle of the measured times, the exponent, and G0 if it is not given."""
    middle, unit = math.sqrt(math.prod(measurement.reach)), float(np.median(measurement.elastic))

    def made(x: FloatArray) -> Law:
        modulus, shape, *spring = x.tolist()
        G0 = relaxed if relaxed is not None else unit * math.exp(spring[0])
        law: Law = PowerLaw(unit * math.exp(modulus), middle, 0.01 + 0.98 * float(expit(shape)), G0)
        return law

    spring = [] if relaxed is not None else [math.log(float(measurement.elastic.min()) / unit / 2)]
    return _Unknowns(made, [[0.0, float(logit(a)), *spring] for a in EXPONENTS])


MODELS: Mapping[str, Callable[[Measurement, float | None], _Unknowns]] = {
    "fractional_zener": partial(_relaxing, FractionalZener, "exponent"),
    "power_law": _power_law,
    "kohlrausch": partial(_relaxing, Kohlrausch, "exponent"),
    "havriliak_negami": _havriliak_negami,
}
