"""The contact problem of one time step, and its solution.

Find the displacement u of the surface (positive upward, under the punch's surface h) that minimises the
elastic energy, whose force is f = IFFT(-kappa FFT(u) + b), plus the energy of the interface, with u <= h and

* a mean displacement of zero, where the body does not yield in the mean (kappa = 0 at q = 0), or
* a given mean pressure, with the mean of u, and so the depth of the punch, unknown, or
* neither, where kappa > 0 at q = 0: a compressible layer on a rigid base carries its own mean.

Under a moving punch kappa has an imaginary part too, and f no energy (`loss_stiffness`).

The compressive stress of the surface is p = f + lambda, and the pressure of the wall p_c = p + tau(g), with
the traction tau of the interface (zero for the hard wall), satisfies p_c >= 0 and p_c = 0 wherever the gap
g = h - u is open. lambda is the multiplier of the first constraint, the given pressure in the second case and
zero in the third. The mean pressure is mean(f) + lambda in each.

With a hardness H the pressure of the wall ends there: p_c <= H, and where p_c = H the surface may overlap the
punch, u > h. The overlap is the height that the surfaces lose in the step, see `loading`; it leaves no gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.contact.residual import Assessment, ResidualFloor, assess_over, mark_contact, scales_over
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import Resumable

# Depths count as at least this part of the range of the punch's heights: less is rounding of h - u.
# A surface that heals under a flat punch at depth zero stops there.
DEPTH_FLOOR = 1e-14
_OF_SUMS = 1e-12  # relative, of the sum of a stress and a traction


@dataclass(frozen=True)
class Problem:
    """The minimisation of one time step, in flat arrays: one value a point, or a mode."""

    stiffness: FloatArray  # modes: kappa >= 0, minus the slopes of the paper's line 5; pressure per length
    intercept: ComplexArray  # modes: b, the intercepts of line 6, as an unnormalised transform; pressure
    obstacle: FloatArray  # points: h, the surface of the punch; length
    mean_pressure: float | None = None  # to be reached; without it the depth is the given quantity
    # modes: imaginary part of kappa, which `LossStiffnessSolver` solves for; zero at q = 0
    loss_stiffness: FloatArray | None = None
    height: float = 0.0  # range of the punch's heights, beside which depths are rounded; zero where exact
    interface: Interaction = HARD_WALL  # across the gap, beside u <= h
    ranks: Ranks = ALONE  # the processes of whose grid these are the points and modes
    hardness: float = math.inf  # largest pressure of the wall; infinite where the surfaces do not yield

    @cached_property
    def mean_stiffness(self) -> float:
        """Stiffness at q = 0."""
        return float(self.ranks.mean_wave(self.stiffness))

    @property
    def mean_is_fixed(self) -> bool:
        """Whether the mean displacement is prescribed (as zero) and lambda unknown."""
        return self.mean_pressure is None and self.mean_stiffness == 0

    @property
    def applied_pressure(self) -> float:
        """The part of lambda that is known beforehand."""
        return self.mean_pressure or 0.0

    @cached_property
    def kappa_1(self) -> float:
        """kappa_1, the smallest stiffness of a mode that is not the mean."""
        return self.ranks.minimum(float(self.stiffness[1 if self.ranks.first else 0 :].min()))

    @property
    def least_depth(self) -> float:
        """The smallest depth that rounding of the heights lets count."""
        return DEPTH_FLOOR * self.height

    @cached_property
    def residual_floor(self) -> ResidualFloor:
        """Bounds of the residual's scales."""
        if not self.interface.attracts:
            return ResidualFloor(self.kappa_1, self.least_depth)
        return ResidualFloor(self.kappa_1, self.least_depth, self.interface.strength, self.interface.range)

    def wall_pressure(self, pressure: FloatArray, gap: FloatArray) -> FloatArray:
        """Pressure p_c = p + tau(g) of the wall, from the compressive stress p of the surface."""
        return pressure + self.interface.traction(gap) if self.interface.attracts else pressure

    @property
    def flow_stress(self) -> float:
        """Stress p of the surface where it yields: the hardness less the traction in contact."""
        return self.interface.flow_stress(self.hardness)

    def at_hardness(self, pressure: FloatArray, gap: FloatArray) -> BoolArray:
        """Whether the pressure of the wall is the hardness, from the stress p."""
        return np.asarray(self.wall_pressure(pressure, gap) >= (1.0 - _OF_SUMS) * self.hardness)

    def capped(self, pressure: FloatArray, yields: BoolArray) -> FloatArray:
        """Return stresses p that are the flow stress where the surface yields, and nowhere more."""
        return np.where(yields, self.flow_stress, np.minimum(pressure, self.flow_stress))


@dataclass(frozen=True)
class Solution:
    """The solution of a problem; fields have one value a point."""

    displacement: FloatArray  # u <= h + flow, with the mean constraint satisfied to rounding
    pressure: FloatArray  # p = f + lambda, the compressive stress at every point
    wall_pressure: FloatArray  # p_c, of the wall
    gap: FloatArray  # h + flow - u
    spectrum: ComplexArray  # unnormalised transform of u, with which the history is carried on
    mean_pressure: float  # pbar, the mean of p
    mean_gap: float
    contact_area: float  # fraction of the points in contact
    residual: float  # see `residual`
    transforms: int  # FFT pairs spent; those of a part of the surface count as that part, rounded over steps
    iterations: int
    converged: bool  # whether the residual is within the tolerance
    # Energy per area lost in instabilities; zero where the step stays on its branch.
    released_energy: float = 0.0
    # Distance from an instability: the least curvature of the energy, over that without an interface; zero
    # where the branch ends. NaN from solvers that do not know it.
    margin: float = math.nan
    flow: FloatArray | None = None  # height lost in the step, where the pressure is at the hardness


def in_contact(problem: Problem, solution: Solution) -> BoolArray:
    """Whether each point is in contact: pressure larger than gap, each in the scale of the residual."""
    wall = solution.wall_pressure
    scales = scales_over(problem.ranks, wall, solution.displacement, problem.residual_floor)
    touching = np.empty(wall.size, bool)
    mark_contact(wall, solution.gap, 1.0 / scales[0], 1.0 / scales[1], touching)
    return touching


class Solver(Resumable, Protocol):
    """A method for `Problem`; one object serves all steps of a run.

    A solve that does not converge leaves the resumable state as it was.
    """

    @property
    def starts_from(self) -> Literal["displacement", "pressure", "gap"]:
        """The field that a first guess is of."""
        ...

    def solve(self, problem: Problem, start: FloatArray, tolerance: float, limit: int) -> Solution:
        """Solve from a first guess.

        Parameters
        ----------
        problem : Problem
            The contact problem of a step.
        start : ndarray, one value a point
            First guess of the field `starts_from`; may be overwritten.
        tolerance : float
            Largest residual of a solution.
        limit : int
            Most iterations.

        Returns
        -------
        Solution
            `converged` tells whether the tolerance was reached.

        Raises
        ------
        ValueError
            If the punch is too deep: mean(h) < 0 for a body of fixed mean.
        """
        ...

    def compile(self) -> None:
        """Compile the kernels that an ordinary step does not call, before a run."""
        ...


FINER_LIMIT = 1000  # iterations of a solve that may fail


def solve_finer(
    solver: Solver, problem: Problem, start: FloatArray, finer: float, tolerance: float, limit: int
) -> Solution:
    """Solve to a finer tolerance; where this fails, to the given one."""
    # Adaptive steps need the finer one on bodies with a large ratio of glassy to relaxed modulus. The error
    # of the displacement returns in the stress of the next steps, multiplied by this ratio. Above the
    # tolerance of the steps it looks like curvature of u(t), and no shorter step lowers it.
    if not finer < tolerance:
        return solver.solve(problem, start, tolerance, limit)
    tight = solver.solve(problem, start.copy(), finer, min(FINER_LIMIT, limit))
    if tight.converged:
        return tight
    if tight.residual <= tolerance:  # the second solve confirms that its state keeps the constraints too
        start = getattr(tight, solver.starts_from)
    loose = solver.solve(problem, start, tolerance, limit)
    pairs, iterations = tight.transforms + loose.transforms, tight.iterations + loose.iterations
    return replace(loose, transforms=pairs, iterations=iterations)


def make_solution(
    problem: Problem,
    displacement: FloatArray,
    pressure: FloatArray,
    spectrum: ComplexArray,
    *,
    spent: tuple[int, int],
    within: float,
    assessment: tuple[float, float, float, float] | None = None,
    gap: FloatArray | None = None,
    flow: FloatArray | None = None,
    least_residual: float = 0.0,
    released_energy: float = 0.0,
    margin: float = math.nan,
) -> Solution:
    """Return a state with its residual and means; it converged if its residual is `within` a bound."""
    # `spent` are FFT pairs and iterations, `assessment` the result of `residual.assess`, `gap` is h - u; the
    # last two where they are known. The residual counts as `least_residual` at least.
    gap = problem.obstacle - displacement if gap is None else gap
    wall = problem.wall_pressure(pressure, gap)
    if assessment is None:
        assessment = assess_over(problem.ranks, wall, displacement, problem.obstacle, problem.residual_floor)
    assessed = Assessment(*assessment)
    return Solution(
        displacement=displacement,
        pressure=pressure,
        wall_pressure=wall,
        gap=gap,
        spectrum=spectrum,
        mean_pressure=assessed.mean_pressure if wall is pressure else problem.ranks.mean(pressure),
        mean_gap=assessed.mean_gap,
        contact_area=assessed.contact_area,
        residual=max(assessed.residual, least_residual),
        transforms=spent[0],
        iterations=spent[1],
        converged=bool(assessed.residual <= within),
        released_energy=released_energy,
        margin=margin,
        flow=flow,
    )


def why_not_converged(problem: Problem, solution: Solution, method: str, tolerance: float) -> str:
    """Return why a state is no solution: by its residual, by its overlap, or for want of a minimum."""
    spent = f"after {solution.iterations} iterations of {method}"
    residual = f"residual {solution.residual:.2e} {spent}; the tolerance is {tolerance:.2e}"
    if not solution.residual <= tolerance:
        return residual
    overlap = problem.ranks.maximum(-float(solution.gap.min()))
    if overlap > 0:
        return (
            f"the surface overlaps the punch by {overlap:.2e} {spent}, more than rounding does ({residual})"
        )
    if problem.interface.attracts:
        return f"no minimum of the energy {spent} ({residual})"
    return f"the mean was not kept {spent} ({residual})"


def surface_at(problem: Problem, gap: FloatArray) -> FloatArray:
    """Displacement of a surface at a gap from the punch; the surface at rest where the gap is not finite."""
    surface = problem.obstacle - gap
    known = problem.ranks.minimum(int(np.isfinite(surface).all()))
    return surface if known else np.zeros_like(surface)


# Projection onto the constraints: no overlap, u <= h, and a mean displacement of zero.

_ROUNDING = 2.3e-16


def project(u: FloatArray, h: FloatArray, mean_is_fixed: bool, ranks: Ranks = ALONE) -> None:
    """Project u in place onto u <= h and, where the mean is fixed, onto mean(u) = 0 as well."""
    # ValueError if both are impossible: the punch is too deep, mean(h) < 0.
    np.minimum(u, h, out=u)
    if mean_is_fixed and not _zero_mean(u, h, ranks):
        raise ValueError(
            "the punch is too deep: the mean height of its surface lies below zero, "
            "and the body keeps its mean height"
        )


def _zero_mean(u: FloatArray, h: FloatArray, ranks: Ranks) -> bool:
    """Shift the points below h by the one distance m that gives min(u + m, h) a mean of zero, if any."""
    # Points at h stay there, so that a solver that tells contact by u = h does not lose it over a rounding
    # error of the mean; where every point is at h they all move. The sum of min(u + m, h) is concave and
    # piecewise linear in m and lies below the sum of u + m, so Newton's iteration started from the latter's
    # root comes from the left and ends after finitely many rounds. Each round moves u itself, so that the
    # next one sees its rounding.
    begun = False
    while True:
        *sums, largest = _excess(u, h)
        total, free, size = ranks.total(np.array([*sums, u.size])).tolist()
        all_move, begun = free == 0 and not begun, True
        if abs(total) <= _ROUNDING * ranks.maximum(float(largest)) * size:
            return True
        if (free == 0 and not all_move) or not np.isfinite(total):
            return False
        _shift(u, h, -total / (size if all_move else free), all_move)


@kernel
def _excess(u: FloatArray, h: FloatArray) -> tuple[float, float, float]:
    """Sum of u, number of points below h, and largest magnitude of u."""
    total, carry, free, largest = 0.0, 0.0, 0.0, 0.0
    for i in range(u.size):
        value = u[i]
        free += 1.0 if value < h[i] else 0.0
        largest = max(largest, abs(value))
        summed = total + value
        carry += (total - summed) + value if abs(total) >= abs(value) else (value - summed) + total
        total = summed
    return total + carry, free, largest


@kernel
def _shift(u: FloatArray, h: FloatArray, shift: float, all_move: bool) -> None:
    for i in range(u.size):
        if u[i] < h[i] or all_move:
            u[i] = min(u[i] + shift, h[i])
