"""Fits of laws with a continuous spectrum to measured curves.

The parameters minimise the squares of the relative errors of the moduli, as in `prony`, from several starts.
Moduli and times enter by their logarithms and exponents by their logits, so no bound is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares
from scipy.special import expit, logit

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.materials import Law
from gfmdlayer.fitting import prony
from gfmdlayer.fitting.measurement import Measurement
from gfmdlayer.fitting.prony import FLOWING, Fit

EXPONENTS = (0.25, 0.5, 0.8)  # of the starts
BEST = 3  # starts that are refined by least squares
LIMIT = 30.0  # of the logarithms and logits
NO_SPRING = 1e-3  # of the lowest modulus: a weaker spring beside a springpot is left out


@dataclass(frozen=True)
class _Unknowns:
    """A law as a function of unbounded numbers, and starts for them."""

    law: Callable[[FloatArray], Law]  # from the numbers to the law
    starts: list[list[float]]


def fit_law(measurement: Measurement, model: str, relaxed: float | None = None) -> Fit:
    """Fit the law MODELS[model] to a measured curve, with G0 = `relaxed` if given."""
    if not (model == "power_law" and relaxed == 0):
        prony.check_relaxed(measurement, relaxed)
    unknowns = MODELS[model](measurement, relaxed)
    wanted = measurement.moduli

    def residual(x: FloatArray) -> FloatArray:
        law = unknowns.law(x.clip(-LIMIT, LIMIT))
        return np.ravel(measurement.predicted(law, measurement.abscissa) / wanted - 1)

    starts = sorted(unknowns.starts, key=lambda start: float(np.sum(residual(np.array(start)) ** 2)))
    found = [least_squares(residual, start, x_scale="jac") for start in starts[:BEST]]
    best = min(found, key=lambda each: each.cost)
    law = unknowns.law(best.x.clip(-LIMIT, LIMIT))
    lowest = float(wanted[0].min())
    if relaxed is None and isinstance(law, PowerLaw) and 0 < law.G0 < NO_SPRING * lowest:
        return fit_law(measurement, model, 0.0)
    if relaxed is None and not isinstance(law, PowerLaw) and law.relaxed < FLOWING * lowest:
        raise prony.flows(measurement, law.relaxed)
    return Fit(measurement, law, prony.least_error(measurement, relaxed or None))


def _relaxing(
    law: Callable[..., Law], exponent: str, measurement: Measurement, relaxed: float | None
) -> _Unknowns:
    """Unknowns G0 (if not given), Ginf - G0, tau and an exponent."""
    elastic = measurement.moduli[0]
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


def _fractional_zener(measurement: Measurement, relaxed: float | None) -> _Unknowns:
    return _relaxing(FractionalZener, "exponent", measurement, relaxed)


def _kohlrausch(measurement: Measurement, relaxed: float | None) -> _Unknowns:
    return _relaxing(Kohlrausch, "exponent", measurement, relaxed)


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
    middle, unit = math.sqrt(math.prod(measurement.reach)), float(np.median(measurement.moduli[0]))

    def made(x: FloatArray) -> Law:
        modulus, shape, *spring = x.tolist()
        G0 = relaxed if relaxed is not None else unit * math.exp(spring[0])
        law: Law = PowerLaw(unit * math.exp(modulus), middle, 0.01 + 0.98 * float(expit(shape)), G0)
        return law

    spring = [] if relaxed is not None else [math.log(float(measurement.moduli[0].min()) / unit / 2)]
    return _Unknowns(made, [[0.0, float(logit(a)), *spring] for a in EXPONENTS])


MODELS: Mapping[str, Callable[[Measurement, float | None], _Unknowns]] = {
    "fractional_zener": _fractional_zener,
    "power_law": _power_law,
    "kohlrausch": _kohlrausch,
    "havriliak_negami": _havriliak_negami,
}
