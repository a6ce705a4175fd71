"""The contact problem in pressures: how a solver that works in them begins, and what it hands back.

With A = 1/kappa mode by mode (0 where kappa is), u = u0 - A p, where u0 is the displacement without pressure,
and gap = gap0 + A p; see `active_set`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gfmdlayer.contact.active_set_loop import raise_clear
from gfmdlayer.contact.active_set_state import Iterate, System
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import Problem, Solution, assess, extent
from gfmdlayer.contact.projection import project
from gfmdlayer.contact.transforms import ComplexArray, Transforms

_ROUNDING = 1e-12  # part of the depth


def in_pressures(problem: Problem, transforms: Transforms) -> tuple[System, ComplexArray]:
    """Return the problem in pressures and the transform of u0, both per point; one transform."""
    n = problem.obstacle.size
    compliance = np.zeros_like(problem.stiffness)
    np.divide(1.0, problem.stiffness * n, out=compliance, where=problem.stiffness != 0)
    free = problem.intercept * compliance
    gap0 = problem.obstacle - transforms.backward(free)
    load = problem.mean_pressure is not None
    return System(compliance, problem.stiffness / n, gap0, problem.obstacle, problem.softest, load), free


def set_pressure(at: Iterate, system: System, problem: Problem, start: FloatArray) -> None:
    """Make the first guess of the pressure admissible: not negative, and of the given mean."""
    np.maximum(start, 0.0, out=at.p)
    if system.load:
        if not at.p.any():
            at.p[np.argmin(system.gap0)] = 1.0
        np.multiply(at.p, problem.applied_pressure / at.p.mean(), out=at.p)


def accept(
    problem: Problem,
    system: System,
    free: ComplexArray,
    at: Iterate,
    tolerance: float,
    transforms: int,
    iterations: int,
) -> Solution:
    """Raise the pressure until nothing overlaps, and judge the state that this gives."""
    n = at.p.size
    displacement, pressure = np.empty(n), np.empty(n)
    lift, overlap = raise_clear(system, at, displacement, pressure)
    spectrum = n * (free - (1 + lift) * system.compliance * at.spectrum)
    if system.load:
        spectrum[0] = displacement.sum()
    residual, contact_area, mean_pressure = assess(pressure, displacement, problem.obstacle, problem.softest)
    _, depth = extent(pressure, displacement)
    return Solution(
        displacement=displacement,
        pressure=pressure,
        spectrum=spectrum,
        mean_pressure=mean_pressure,
        contact_area=contact_area,
        residual=residual,
        transforms=(transforms + 1) // 2,
        iterations=iterations,
        converged=bool(residual <= tolerance and overlap <= _ROUNDING * depth),
    )


def admit(
    problem: Problem, system: System, at: Iterate, transforms: Transforms, failed: Solution
) -> Solution:
    """Return what belongs together although it is no solution: the surface pushed clear, and its pressure.

    Raises
    ------
    ValueError
        If the punch displaces more than the cell holds (mean(h) < 0 for a body of fixed mean).
    """
    if system.load and np.isfinite(at.gap).all():
        return replace(failed, converged=False)  # the depth has given way, which is exact
    n, u = at.p.size, problem.obstacle - at.gap
    if np.isfinite(u).all():
        project(u, problem.obstacle, problem.mean_is_fixed)
    spectrum = transforms.forward(u)
    pressure = transforms.backward((problem.intercept - problem.stiffness * spectrum) / n)
    if problem.mean_is_fixed:
        # As with no force on the free points in the mean; where there are none, as contact becomes full.
        open_ = u < problem.obstacle
        pressure -= pressure[open_].mean() if open_.any() else pressure.min()
    residual, contact_area, mean_pressure = assess(pressure, u, problem.obstacle, problem.softest)
    return replace(
        failed,
        displacement=u,
        pressure=pressure,
        spectrum=spectrum,
        mean_pressure=mean_pressure,
        contact_area=contact_area,
        residual=residual,
        transforms=failed.transforms + 1,
        converged=False,
    )
