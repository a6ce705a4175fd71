"""FIRE: minimisation by inertial dynamics that is steered along the force and stopped when it runs uphill.

After Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201, and its use in Green's function molecular dynamics by
Zhou, Moseler and Mueser, Phys. Rev. B 99 (2019) 144103 (the paper's Ref. [8]), with the semi-implicit Euler
steps and the mixing before the step of Guenole et al., Comput. Mater. Sci. 175 (2020) 109584. Left out:
the delay before the time step grows (it brings nothing here) and the limit on the number of uphill steps
(the iteration limit ends the loop).

Each point moves in its own direction only, so a hard wall is a clamp: a point that is pressed against the
punch loses its velocity and its force, and is released when its pressure changes sign.

Two inertias:

uniform
    One mass for every point.  The stiffest of the n/2 modes sets the time step and the softest the number of
    iterations. One FFT pair an iteration.
mass-weighted
    The force of the free points alone is divided, mode by mode, by kappa + kappa_1 before it accelerates
    them, so that all wavelengths move at a similar pace.  Forces of pressed points must not enter: a
    projection of a step that mixes them in is no descent. Two FFT pairs an iteration.

The traction of an interface that attracts is a part of the force. It has no part in the inertia: where it
attracts its energy is concave in the gap, and makes no mode stiffer. Inertia may carry the surface over a
barrier where an energy has several minima: `newton` follows the path.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.fire_loop import Constants, Fields, Inertia, Minimisation, State, iterate
from gfmdlayer.contact.pressure_form import trivial_solution
from gfmdlayer.contact.problem import Problem, Solution, make_solution, surface_at
from gfmdlayer.contact.projection import project
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.resumable import Stateless

_CHUNK = 1 << 21  # points moved between two looks at signals: some 20 ms


# Measured over the ramp and the hold of the paper's default case, halfspaces, rigid bases and thin layers at
# n = 2^12 to 2^16.
MASS_WEIGHTED = Constants(first_step=0.4, longest_step=0.6, mixing=0.5, growth=1.1, cut=0.8, decay=0.99)
UNIFORM = Constants(first_step=0.5, longest_step=1.0, mixing=0.1, growth=1.1, cut=0.5, decay=0.99)


class Fire(Stateless):
    """FIRE for the steps of one run.

    Parameters
    ----------
    transforms : Transforms
        Plans for the grid's shape.
    tolerance : float
        Residual at which a step is accepted.
    max_iterations : int
        Iterations after which the step counts as not converged.
    mass_weighted : bool
        Inertia by mode, or one for all.
    starts_from : {"displacement", "gap"}
        The field that a first guess is of: the gap keeps the contact where an interface attracts.
    """

    def __init__(
        self,
        transforms: Transforms,
        tolerance: float = 1e-6,
        max_iterations: int = 20_000,
        *,
        mass_weighted: bool = True,
        starts_from: Literal["displacement", "gap"] = "displacement",
    ) -> None:
        self.starts_from: Literal["displacement", "gap"] = starts_from
        self._transforms = transforms
        self._tolerance = tolerance
        self._max_iterations = max_iterations
        self._mass_weighted = mass_weighted
        u, v, stress, force = (transforms.empty_field() for _ in range(4))
        acceleration = transforms.empty_field() if mass_weighted else stress
        self._fields = Fields(u, v, stress, force, acceleration, transforms.empty_spectrum())

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Minimise from a first guess of the displacement.

        Raises
        ------
        ValueError
            If the punch displaces more than the cell holds (mean(h) < 0 for a body of fixed mean).
        """
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        fields = self._fields
        fields.u[:] = start if self.starts_from == "displacement" else surface_at(problem, start)
        fields.v[:] = 0.0
        project(fields.u, problem.obstacle, problem.mean_is_fixed)
        constants = MASS_WEIGHTED if self._mass_weighted else UNIFORM
        state = State(constants.first_step, constants.mixing, problem.applied_pressure, 0.0)
        chunk = max(16, _CHUNK // fields.u.size)
        iterations = pairs = 0
        accepted, projected = False, True
        while not accepted and iterations < self._max_iterations:
            limit = min(chunk, self._max_iterations - iterations)
            state, converged, done, more = self._iterate(problem, constants, state, self._tolerance, limit)
            iterations += done
            pairs += more
            # The loop keeps the mean to first order only.  An accepted state has it exactly, and is judged as
            # it is.
            projected = projected and done == 0
            accepted = converged and projected
            if not projected and (converged or iterations == self._max_iterations):
                project(fields.u, problem.obstacle, problem.mean_is_fixed)
                state = state._replace(drift=0.0)
                projected = True
        if not accepted:
            # The state returned is consistent even so.
            state, _, _, more = self._iterate(problem, constants, state, np.inf, 1)
            pairs += more
        pressure = fields.stress + state.multiplier
        if problem.interface.attracts:
            pressure -= problem.interface.traction(problem.obstacle - fields.u)
        return make_solution(
            problem,
            fields.u.copy(),
            pressure,
            self._transforms.forward(fields.u),
            spent=(pairs + 1, iterations),
            within=np.inf if accepted else -1.0,
        )

    def _iterate(
        self, problem: Problem, constants: Constants, state: State, tolerance: float, limit: int
    ) -> tuple[State, bool, int, int]:
        system = Minimisation(
            problem.stiffness,
            problem.intercept,
            problem.obstacle,
            problem.mean_is_fixed,
            problem.residual_floor,
            problem.interface.terms,
        )
        inertia = self._inertia(problem)
        outcome: tuple[State, bool, int, int] = iterate(
            self._transforms.plans, system, self._fields, inertia, constants, state, tolerance, limit
        )
        return outcome

    def _inertia(self, problem: Problem) -> Inertia:
        if not self._mass_weighted:
            return Inertia(problem.stiffness, 1.0 / float(problem.stiffness.max()), False)
        inverse = 1.0 / ((problem.stiffness + problem.softest) * self._fields.u.size)
        if problem.mean_is_fixed:
            inverse[0] = 0.0
        return Inertia(inverse, 1.0, True)
