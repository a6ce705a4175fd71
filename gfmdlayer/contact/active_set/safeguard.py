"""Fallback of the active set: constrained conjugate gradients, and `descent` if they fail.

Where distant points of the contact push each other out, as under a film that bends, the set may cycle.
Conjugate gradients never raise the energy and mostly end soon, though no proof says so. The descent
converges for every convex problem, if slowly.
"""

from __future__ import annotations

from gfmdlayer.contact.active_set.descent import descend
from gfmdlayer.contact.conjugate_gradient import iterate, make_search
from gfmdlayer.contact.pressure_form import Iterate, System, set_pressure
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import compiling

_PORTION = 200  # iterations between two looks at signals


def safeguard(
    transforms: Transforms,
    system: System,
    problem: Problem,
    at: Iterate,
    shift: float,
    tolerance: float,
    limit: int,
) -> tuple[bool, int, int]:
    """Improve an iterate until no point violates the conditions for a gap of ``shift`` in the contact.

    Parameters
    ----------
    transforms : Transforms
        Of the surface.
    system, problem : System, Problem
        The problem, in pressures and in displacements.
    at : Iterate
        Pressure and gap to begin with, and on return.
    shift : float
        Gap in the contact that is aimed at; length.
    tolerance : float
        On the violation at each point.
    limit : int
        Most iterations; at most half of them go into conjugate gradients.

    Returns
    -------
    Whether the tolerance was reached, the transforms and the iterations.
    """
    found, taken, done, search = False, 0, 0, make_search(transforms)
    if not iterate.signatures:  # type: ignore[attr-defined]
        with compiling():  # rarely needed, and thus not compiled beforehand
            iterate(transforms.plans, system, at, search, shift, tolerance, 0)
            descend(transforms.plans, system, at, search.work, 1.0, 0.0, shift, tolerance, 0)
    set_pressure(at, system, problem, at.p)
    while not found and done < limit // 2:
        portion = min(_PORTION, limit // 2 - done)
        found, more, ended = iterate(transforms.plans, system, at, search, shift, tolerance, portion)
        taken, done = taken + more, done + ended
        if ended < portion:
            break
    length = float(problem.stiffness[problem.stiffness > 0].min())
    while not found and done < limit:
        found, more = descend(
            transforms.plans, system, at, search.work, length, problem.applied_pressure,
            shift, tolerance, min(_PORTION, limit - done),
        )  # fmt: skip
        taken, done = taken + 2 * more, done + more
    return found, taken, done
