"""The contact problem of one time step: what every solver is given, what it returns, and when it may stop.

Find the displacement u of the surface (positive upward, under the punch's surface h) that minimises the
energy whose force is f = IFFT(-kappa FFT(u) + b), with u <= h, and either

* a mean displacement of zero (a body that does not yield in the mean, kappa = 0 at q = 0), or
* a given mean pressure (the mean of u, and so the depth of the punch, is found), or
* neither (kappa > 0 at q = 0: a compressible layer on a rigid base carries its own mean).

Under a moving punch kappa has an imaginary part too, and the force no energy (`drag`).

The contact pressure is p = f + lambda >= 0 with p = 0 wherever the gap h - u is open.  lambda is the
multiplier of the first constraint, the given pressure in the second case and zero in the third.  The mean
pressure is mean(f) + lambda in each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.kernels import LANES, kernel
from gfmdlayer.resumable import Resumable

# Pressures count against at least this part of what the softest mode carries at the depth of the surface.
# Without it a surface that nothing touches would measure rounding errors against rounding errors: those reach
# 1e-16 n/2 of that pressure, 1e-10 at n = 2^20, which a tolerance of 1e-6 then still tells from contact.
_NO_PRESSURE = 1e-3

# Depths count as at least this part of the range of the punch's heights: what is less is rounding of h - u.
# A surface that is left to itself, under a flat punch at depth zero, comes to rest there.
_NO_DEPTH = 1e-14


class ResidualFloor(NamedTuple):
    """What the residual's scales are made of where there is next to no pressure, or depth."""

    stiffness: float  # kappa_1, the smallest of a mode that is not the mean
    depth: float


@dataclass(frozen=True)
class Problem:
    """The minimisation of one time step, in flat arrays.

    Parameters
    ----------
    stiffness : ndarray, one value a mode
        kappa >= 0, minus the slopes of the paper's line 5, in pressure per length.
    intercept : ndarray of complex, one value a mode
        b, the intercepts of the paper's line 6, as an unnormalised transform.
    obstacle : ndarray, one value a point
        h, the surface of the punch.
    mean_pressure : float, optional
        The mean pressure that is to be reached; without it the depth is the given quantity.
    drag : ndarray, one value a mode, optional
        Imaginary part of kappa, which only `LossStiffnessSolver` solves for; zero at q = 0.
    height : float
        Range of the punch's heights, beside which depths are known to rounding; zero where they are exact.
    """

    stiffness: FloatArray
    intercept: ComplexArray
    obstacle: FloatArray
    mean_pressure: float | None = None
    loss_stiffness: FloatArray | None = None
    height: float = 0.0

    @property
    def mean_is_fixed(self) -> bool:
        """Whether the mean displacement is prescribed (as zero) and lambda is to be found."""
        return self.mean_pressure is None and self.stiffness[0] == 0

    @property
    def applied_pressure(self) -> float:
        """The part of lambda that is known beforehand."""
        return self.mean_pressure or 0.0

    @property
    def softest(self) -> float:
        """kappa_1, the smallest stiffness of a mode that is not the mean."""
        return float(self.stiffness[1:].min())

    @property
    def least(self) -> ResidualFloor:
        """What the scales of the residual are made of at least."""
        return ResidualFloor(self.softest, self.least_depth)

    @property
    def least_depth(self) -> float:
        """What depths count at least."""
        return _NO_DEPTH * self.height


@dataclass(frozen=True)
class Solution:
    """What a solver found.

    Attributes
    ----------
    displacement, pressure : ndarray, one value a point
        u, with u <= h and the mean constraint satisfied to rounding, and p = f + lambda at every point.
    gap : ndarray, one value a point
        h - u.
    spectrum : ndarray of complex
        Unnormalised transform of the displacement, which the history is carried on with.
    mean_pressure, mean_gap : float
        pbar, the mean normal stress, and the mean of h - u.
    contact_area : float
        Fraction of the points in contact.
    residual : float
        See `violation`.
    transforms, iterations : int
        FFT pairs (a forward and a backward transform) and iterations that it took. Transforms of a part of
        the surface count as that part of one, rounded from step to step.
    converged : bool
        Whether the residual is within the tolerance.
    """

    displacement: FloatArray
    pressure: FloatArray
    gap: FloatArray
    spectrum: ComplexArray
    mean_pressure: float
    mean_gap: float
    contact_area: float
    residual: float
    transforms: int
    iterations: int
    converged: bool


Assessment = tuple[float, float, float, float]


class Solver(Resumable, Protocol):
    """A method for `Problem`; one object serves all steps of a run."""

    @property
    def starts_from(self) -> Literal["displacement", "pressure"]:
        """What the first guess is of."""
        ...

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from a first guess of what the method starts from; one that did not converge says so."""
        ...


@nb.njit(inline="always")
def violation(pressure: float, gap: float, per_pressure: float, per_gap: float) -> float:
    """How far one point is from p >= 0, gap >= 0, p gap = 0: |min(p/p_max, gap/depth)|.

    The residual of a state is the largest of these over the points, zero exactly at the solution.  Each
    solver stops on it.
    """
    pressure *= per_pressure
    gap *= per_gap
    return abs(pressure if pressure < gap else gap)


@nb.njit(inline="always")
def scales(largest_pressure: float, deepest: float, least: ResidualFloor) -> tuple[float, float]:
    """Scales (p_max, depth) of the residual: the largest pressure and the deepest point of the surface."""
    depth = max(deepest, least.depth, 1e-300)
    return max(largest_pressure, _NO_PRESSURE * least.stiffness * depth, 1e-300), depth


@kernel(reorder=True)
def extent(pressure: FloatArray, u: FloatArray) -> tuple[float, float]:
    """Largest pressure and deepest point of a state without NaN.

    Depths count from zero, or from the mean of u where that is higher: under a given load the punch may be
    anywhere.
    """
    largest, lowest, total = np.zeros(LANES), np.full(LANES, np.inf), 0.0
    for first in range(0, u.size, LANES):
        ps, us = pressure[first : first + LANES], u[first : first + LANES]
        for i in range(us.size):
            largest[i] = ps[i] if ps[i] > largest[i] else largest[i]
            lowest[i] = us[i] if us[i] < lowest[i] else lowest[i]
            total += us[i]
    return largest.max(), max(total / u.size, 0.0) - lowest.min()


@kernel
def scales_of(pressure: FloatArray, u: FloatArray, least: ResidualFloor) -> tuple[float, float]:
    """Scales of the residual of a state."""
    largest, deepest = extent(pressure, u)
    return scales(largest, deepest, least)


@kernel(reorder=True)
def assess(pressure: FloatArray, u: FloatArray, h: FloatArray, least: ResidualFloor) -> Assessment:
    """Judge a state.

    Returns
    -------
    residual, contact_area, mean_pressure, mean_gap : float
        The largest `violation` over the points (NaN if anything is); the fraction of the points where the
        pressure, and not the gap, is the larger of the two in the residual's scales; the means of pressure
        and gap.
    """
    pressure_scale, depth = scales_of(pressure, u, least)
    per_pressure, per_gap = 1.0 / pressure_scale, 1.0 / depth
    worst, touching, total, gaps = np.zeros(LANES), 0.0, 0.0, 0.0
    for first in range(0, u.size, LANES):
        ps, us, hs = pressure[first : first + LANES], u[first : first + LANES], h[first : first + LANES]
        for i in range(us.size):
            gap = hs[i] - us[i]
            off = violation(ps[i], gap, per_pressure, per_gap)
            worst[i] = off if off > worst[i] else worst[i]
            touching += 1.0 if ps[i] * per_pressure > gap * per_gap else 0.0
            total += ps[i]
            gaps += gap
    # The maxima are blind to NaN; the sums are not.
    known = np.isfinite(total) and np.isfinite(gaps)
    return worst.max() if known else np.nan, touching / u.size, total / u.size, gaps / u.size


def make_solution(
    problem: Problem,
    displacement: FloatArray,
    pressure: FloatArray,
    spectrum: ComplexArray,
    *,
    transforms: int,
    iterations: int,
    within: float,
    judgement: Assessment | None = None,
    gap: FloatArray | None = None,
) -> Solution:
    """A state with its observables (see `assess`); it converged if its residual is within a bound.

    Gap and judgement are made where they are not given.
    """
    residual, contact_area, mean_pressure, mean_gap = judgement or assess(
        pressure, displacement, problem.obstacle, problem.least
    )
    return Solution(
        displacement=displacement,
        pressure=pressure,
        gap=problem.obstacle - displacement if gap is None else gap,
        spectrum=spectrum,
        mean_pressure=mean_pressure,
        mean_gap=mean_gap,
        contact_area=contact_area,
        residual=residual,
        transforms=transforms,
        iterations=iterations,
        converged=bool(residual <= within),
    )
