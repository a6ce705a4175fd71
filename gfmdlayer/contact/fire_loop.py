"""The compiled loop of FIRE: three passes over the points around each FFT pair; see `fire` for the method.

The passes count in floating point and choose without branches, so that the vector units take them.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.residual import ResidualFloor, scales, violation
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.interface.forms import interact
from gfmdlayer.interface.terms import Terms
from gfmdlayer.kernels import FASTMATH, kernel


class Constants(NamedTuple):
    """FIRE's constants; the time steps are in units of the inverse frequency of the stiffest mode."""

    first_step: float
    longest_step: float
    mixing: float
    growth: float
    cut: float
    decay: float


class Fields(NamedTuple):
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


class State(NamedTuple):
    """What one call of the loop hands to the next."""

    step: float
    mixing: float
    multiplier: float  # lambda
    drift: float  # excess of each free point that brings the mean off zero


@kernel(reorder=True)
def iterate(
    plans: Plans,
    system: Minimisation,
    fields: Fields,
    inertia: Inertia,
    constants: Constants,
    state: State,
    tolerance: float,
    limit: int,
) -> tuple[State, bool, int, int]:
    """Iterate to the tolerance or the limit.

    Returns the state, whether it is within the tolerance, the iterations and the FFT pairs.
    The scales of the residual are those of the first iteration: the caller accepts only what passes there.
    On return within the tolerance, ``stress``, the traction of the interface in it, belongs to ``u``.
    """
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
            return State(step, mixing, multiplier, drift), True, iteration, pairs
        if mass_weighted:
            forward(plans, force, work)
            pull = 0.0
            for k in range(work.size):
                real, imaginary = inverse_mass[k] * work[k].real, inverse_mass[k] * work[k].imag
                work[k] = complex(real, imaginary)
                pull += real * real + imaginary * imaginary
            pull *= (
                2.0 * u.size
            )  # Parseval, but for the weight of two modes, which does not matter to a norm that only steers
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
    return State(step, mixing, multiplier, drift), False, limit, pairs


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
    """Sums over the forces on the points, and the forces themselves where they are wanted.

    A point that is pressed against the punch feels none, and its velocity does not count.

    Returns the number of points whose `violation` is not within the tolerance (NaN is not), the power (force
    times velocity), and the squared norms of velocity and force.
    """
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
    """Steer and push the velocities, move and clamp what is not pressed; return the new drift of the mean."""
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
