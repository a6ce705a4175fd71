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
    One mass for every point.  The stiffest of the n/2 modes sets the time step and the lowest the number of
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

from typing import Literal, NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.pressure_form import trivial_solution
from gfmdlayer.contact.problem import Problem, Solution, make_solution, project, surface_at
from gfmdlayer.contact.residual import ResidualFloor, scales, violation
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.interface.forms import Terms, interact
from gfmdlayer.kernels import FASTMATH, kernel
from gfmdlayer.resumable import Stateless

# Three passes over the points around each FFT pair. They count in floating point and choose without branches,
# so that the vector units take them.


class Constants(NamedTuple):
    """FIRE's constants; the time steps are in units of the inverse frequency of the stiffest mode."""

    first_step: float
    longest_step: float
    mixing: float
    growth: float
    cut: float
    decay: float


class FireFields(NamedTuple):
    """Work arrays; ``acceleration`` is ``stress`` itself where all masses are equal."""

    u: FloatArray
    v: FloatArray
    stress: FloatArray
    force: FloatArray
    acceleration: FloatArray
    work: ComplexArray


class Minimisation(NamedTuple):
    """The contact problem, as in `Problem`."""

    kappa: FloatArray
    b: ComplexArray
    h: FloatArray
    mean_is_fixed: bool
    floor: ResidualFloor
    terms: Terms  # of the interface


class Inertia(NamedTuple):
    """Factors that turn forces into accelerations: one for each mode, or one for all."""

    inverse_mass: FloatArray
    mobility: float
    mass_weighted: bool


class FireState(NamedTuple):
    """State of the motion between two calls of the loop, beside its fields."""

    step: float
    mixing: float
    multiplier: float  # lambda
    drift: float  # excess of each free point that brings the mean off zero


@kernel(reorder=True)
def iterate(
    plans: Plans,
    system: Minimisation,
    fields: FireFields,
    inertia: Inertia,
    constants: Constants,
    state: FireState,
    tolerance: float,
    limit: int,
) -> tuple[FireState, bool, int, int]:
    """Iterate to the tolerance or the limit; return state, whether it converged, iterations, pairs."""
    # The scales of the residual are those of the first iteration: the caller accepts only what passes there.
    # On return within the tolerance, ``stress``, the traction of the interface in it, belongs to ``u``.
    kappa, b, h, mean_is_fixed, floor, terms = system
    inverse_mass, mobility, mass_weighted = inertia
    u, v, stress, force, acceleration, work = fields
    step, mixing, multiplier, drift = state
    per_point = 1.0 / u.size
    per_pressure = per_gap = 0.0
    pairs = 0
    for iteration in range(limit):
        forward(plans, u, work)
        for k in range(work.size):
            # In parts, which spares the products with an imaginary part of zero.
            real, imaginary = b[k].real - kappa[k] * work[k].real, b[k].imag - kappa[k] * work[k].imag
            work[k] = complex(per_point * real, per_point * imaginary)
        backward(plans, work, stress)
        pairs += 1
        if terms.form.size > 0:
            for i in range(u.size):
                stress[i] += interact(h[i] - u[i], terms)[1]
        if iteration == 0:
            if mean_is_fixed:
                multiplier = _multiplier(stress, u, h)
            pressure_scale, depth = scales(stress.max() + multiplier, max(u.mean(), 0.0) - u.min(), floor)
            per_pressure, per_gap = 1.0 / pressure_scale, 1.0 / depth
        off, power, speed, pull, next_multiplier = _forces(
            stress, multiplier, u, h, v, force, mass_weighted, per_pressure, per_gap, tolerance
        )
        if off == 0.0:
            return FireState(step, mixing, multiplier, drift), True, iteration, pairs
        if mass_weighted:
            forward(plans, force, work)
            pull = 0.0
            for k in range(work.size):
                real, imaginary = inverse_mass[k] * work[k].real, inverse_mass[k] * work[k].imag
                work[k] = complex(real, imaginary)
                pull += real * real + imaginary * imaginary
            # Parseval, but for the weight of two modes, which does not matter to a norm that only steers.
            pull *= 2.0 * u.size
            backward(plans, work, acceleration)
            pairs += 1
        if power > 0.0:
            step = min(step * constants.growth, constants.longest_step)
            mixing *= constants.decay
            keep, retreat = 1.0 - mixing, 0.0
            steer = mixing * np.sqrt(speed / pull) if pull > 0.0 else 0.0
        else:
            # Uphill, or at rest: half a step back, and a fresh start.
            keep, steer, retreat = 0.0, 0.0, 0.5 * step
            step *= constants.cut
            mixing = constants.mixing
        push = steer + (1.0 - mixing) * step * mobility
        offset = 0.0 if mass_weighted else multiplier
        drift = _move(u, v, stress, multiplier, acceleration, offset, h, step, keep, push, retreat, drift)
        if mean_is_fixed:
            multiplier = next_multiplier
        else:
            drift = 0.0
    return FireState(step, mixing, multiplier, drift), False, limit, pairs


@nb.njit(nogil=True, fastmath=FASTMATH)
def _multiplier(stress: FloatArray, u: FloatArray, h: FloatArray) -> float:
    """The lambda that leaves the free points without force in the mean."""
    total, free = 0.0, 0.0
    for i in range(u.size):
        is_free = 1.0 if u[i] < h[i] else 0.0
        total += is_free * stress[i]
        free += is_free
    # In full contact any lambda that keeps the pressure positive will do: take the one at which contact
    # becomes full.
    return -total / free if free > 0.0 else -stress.min()


@nb.njit(nogil=True, fastmath=FASTMATH)
def _forces(  # inlined: groups would gain nothing
    stress: FloatArray,
    multiplier: float,
    u: FloatArray,
    h: FloatArray,
    v: FloatArray,
    force: FloatArray,
    wanted: bool,
    per_pressure: float,
    per_gap: float,
    tolerance: float,
) -> tuple[float, float, float, float, float]:
    """Sum over the forces on the points, and write the forces themselves where they are wanted."""
    # A point that is pressed against the punch feels none, and its velocity does not count.
    #
    # Returns the number of points whose `violation` is not within the tolerance (NaN is not), the power
    # (force times velocity), the squared norms of velocity and force, and the next multiplier.
    off, power, speed, pull, total, free = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(u.size):
        pressure, gap = stress[i] + multiplier, h[i] - u[i]
        off += 0.0 if violation(pressure, gap, per_pressure, per_gap) <= tolerance else 1.0
        is_free = 1.0 if gap > 0.0 else 0.0
        total += is_free * pressure
        free += is_free
        pressed = (gap <= 0.0) & (pressure > 0.0)
        pressure = 0.0 if pressed else pressure
        velocity = 0.0 if pressed else v[i]
        power += pressure * velocity
        speed += velocity * velocity
        pull += pressure * pressure
        if wanted:
            force[i] = pressure
    return off, power, speed, pull, (multiplier - total / free if free > 0.0 else multiplier)


@nb.njit(nogil=True, fastmath=FASTMATH)
def _move(  # inlined: groups would gain nothing
    u: FloatArray,
    v: FloatArray,
    stress: FloatArray,
    multiplier: float,
    acceleration: FloatArray,
    offset: float,
    h: FloatArray,
    step: float,
    keep: float,
    push: float,
    retreat: float,
    drift: float,
) -> float:
    """Steer and push the velocities, move and clamp points that are not pressed; return the new drift."""
    total, free = 0.0, 0.0
    for i in range(u.size):
        touching = u[i] >= h[i]
        pressed = touching & (stress[i] + multiplier > 0.0)
        velocity = 0.0 if pressed else keep * v[i] + push * (acceleration[i] + offset)
        back = (0.0 if pressed else retreat * v[i]) + (0.0 if touching else drift)
        moved = u[i] + step * velocity - back
        moved = moved if moved < h[i] else h[i]
        v[i] = velocity
        u[i] = moved
        total += moved
        free += 1.0 if moved < h[i] else 0.0
    return total / free if free > 0.0 else 0.0


_CHUNK = 1 << 21  # points moved between two looks at signals: some 20 ms


# Measured over the ramp and the hold of the paper's default case, halfspaces, rigid bases and thin layers at
# n = 2^12 to 2^16.
MASS_WEIGHTED = Constants(first_step=0.4, longest_step=0.6, mixing=0.5, growth=1.1, cut=0.8, decay=0.99)
UNIFORM = Constants(first_step=0.5, longest_step=1.0, mixing=0.1, growth=1.1, cut=0.5, decay=0.99)


class Fire(Stateless):
    """FIRE for the steps of one run; from the gap, a start keeps the contact where an interface attracts."""

    def __init__(
        self,
        transforms: Transforms,
        *,
        mass_weighted: bool = True,
        starts_from: Literal["displacement", "gap"] = "displacement",
    ) -> None:
        self.starts_from: Literal["displacement", "gap"] = starts_from
        self._transforms = transforms
        self._mass_weighted = mass_weighted
        u, v, stress, force = (transforms.empty_field() for _ in range(4))
        acceleration = transforms.empty_field() if mass_weighted else stress
        self._fields = FireFields(u, v, stress, force, acceleration, transforms.empty_spectrum())

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Minimise from a first guess of the displacement or the gap."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        fields = self._fields
        fields.u[:] = start if self.starts_from == "displacement" else surface_at(problem, start)
        fields.v[:] = 0.0
        project(fields.u, problem.obstacle, problem.mean_is_fixed)
        constants = MASS_WEIGHTED if self._mass_weighted else UNIFORM
        state = FireState(constants.first_step, constants.mixing, problem.applied_pressure, 0.0)
        chunk = max(16, _CHUNK // fields.u.size)
        iterations = pairs = 0
        accepted, projected = False, True
        while not accepted and iterations < limit:
            most = min(chunk, limit - iterations)
            state, converged, done, more = self._iterate(problem, constants, state, tolerance, most)
            iterations += done
            pairs += more
            # The loop keeps the mean to first order only.  An accepted state has it exactly, and is judged as
            # it is.
            projected = projected and done == 0
            accepted = converged and projected
            if not projected and (converged or iterations == limit):
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

    def compile(self) -> None:
        """Do nothing: an ordinary step calls every kernel."""

    def _iterate(
        self, problem: Problem, constants: Constants, state: FireState, tolerance: float, limit: int
    ) -> tuple[FireState, bool, int, int]:
        system = Minimisation(
            problem.stiffness,
            problem.intercept,
            problem.obstacle,
            problem.mean_is_fixed,
            problem.residual_floor,
            problem.interface.terms,
        )
        if self._mass_weighted:
            inverse = 1.0 / ((problem.stiffness + problem.kappa_1) * self._fields.u.size)
            if problem.mean_is_fixed:
                inverse[0] = 0.0
            inertia = Inertia(inverse, 1.0, True)
        else:
            inertia = Inertia(problem.stiffness, 1.0 / float(problem.stiffness.max()), False)
        outcome: tuple[FireState, bool, int, int] = iterate(
            self._transforms.plans, system, self._fields, inertia, constants, state, tolerance, limit
        )
        return outcome
