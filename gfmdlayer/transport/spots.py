r"""Conductance and stiffness of a given set of contact spots: one problem, that of a rigid flat punch.

    find J on the spots, 0 elsewhere:  ifft(Z fft J) = 1 on the spots;      S = sum J h^2

With the impedance Z(q) of a conductor, S is the conductance of the cell: the spots are at one potential, the
rest is insulated, and charge has no memory (Barber, Proc. R. Soc. A 459 (2003) 53: 1/R = 2/(E* (rho1 + rho2))
dF/dd). With Z = 1/K(q, i omega), S is the dynamic stiffness dF/d(depth) at frozen contact.

Impedances of conductors, potential over current density at the surface, of conductivity k and thickness d:

    halfspace 1/(k q);     a film on Z:  (k q Z + t)/(1 + k q Z t)/(k q),   t = tanh(q d)

At q = 0 the films are in series on a perfect conductor. Otherwise Z(0) = 0: the potential of the spots counts
from the mean potential of the surface, and 1/S is the constriction resistance.

Beside an attraction the points out of contact follow too: with the curvature c = d^2w/dg^2 of the interface
at their gaps, a step of the depth by one sinks them by 1 + v,

    K (1 + v) + c v = constant out of contact,        v = 0 on the spots;        S = sum K (1 + v) h^2

where the constant is zero if the body resists its mean displacement. Otherwise it makes the mean of 1 + v
zero, and is the mean pressure. Both follow from y, (K + c) y = 1 out of contact: v = -K(0) y, or v is
proportional to y. S falls to -inf where the contact becomes unstable.

Spectral kernels see the edge of the spots inside the outline of their points: 0.13 spacings inside the radius
of equal area of a disc, 0.19 beside a strip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.materials import Elastic
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.body.wavevectors import Wavevectors

Field = NDArray[Any]  # real, or complex where Z is
TOLERANCE = 1e-8  # of the sum, relative
_MOST_ITERATIONS = 2000


def impedance(q: FloatArray, films: Sequence[tuple[float, float]], base: float) -> FloatArray:
    """Impedance at wavenumbers q of films (thickness, conductivity), the uppermost first, on a base."""
    # The base is the conductivity of a halfspace; inf is a perfect conductor, 0 an insulator.
    q = np.asarray(q, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.zeros(q.shape) if math.isinf(base) else 1 / (base * q) if base else np.full(q.shape, np.inf)
        for thickness, k in reversed(films):
            t, scaled = np.tanh(q * thickness), k * q * z
            z = np.where(np.isinf(z), 1 / t, (scaled + t) / (1 + scaled * t)) / (k * q)
    return np.where(q > 0, z, in_series(films) if math.isinf(base) else 0.0)


def in_series(films: Sequence[tuple[float, float]]) -> float:
    """Resistance of films (thickness, conductivity) times their area."""
    return sum(thickness / k for thickness, k in films)


def inverse(stiffness: Field) -> Field:
    """Return Z = 1/K, with Z = 0 at a mean displacement that the body does not resist."""
    K = np.asarray(stiffness)
    return np.where(K == 0, 0.0, 1 / np.where(K == 0, 1.0, K))


class Conductors:
    """Two conductors as a body of the stiffness 1/Z(q), which may answer without periodic images.

    Parameters
    ----------
    sides : sequence of pairs
        Films (thickness, conductivity), the uppermost first, and the conductivity of the base.
    """

    def __init__(self, sides: Sequence[tuple[Sequence[tuple[float, float]], float]]) -> None:
        self._sides = sides

    @property
    def mean_stiffness(self) -> float:
        """1/Z at q = 0, where both bases are perfect conductors."""
        return float(self.stiffness(np.zeros(1), 0.0)[0])

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:  # noqa: ARG002
        """Return 1/Z(q); charge has no memory."""
        q = np.asarray(Wavevectors.of(waves).magnitude, dtype=float)
        Z = np.sum([impedance(q, films, base) for films, base in self._sides], axis=0)
        grounded = all(math.isinf(base) for _, base in self._sides)
        return np.asarray(np.where((q > 0) | grounded, 1 / np.where(Z > 0, Z, 1.0), 0.0))

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return no relaxing modes."""
        return Spectrum.of_material(self.stiffness(waves, 0.0), Elastic(1.0))


class Spots:
    """The flat-punch problem for the contacts of successive steps, each started from the density before.

    Parameters
    ----------
    Z : ndarray
        Impedance at the waves of a real transform, real or complex.
    cell : float
        Area of a grid cell; of a line, the spacing.
    tolerance : float
        Of the sum, relative.
    """

    def __init__(self, Z: Field, cell: float, tolerance: float = TOLERANCE) -> None:
        self._Z, self._cell, self._tolerance = Z, cell, tolerance
        # The preconditioner: 1/Z, restricted to the spots.
        self._K = 1 / np.where(Z == 0, np.abs(Z).max(), Z)
        self.density: Field | None = None
        self.iterations = 0

    def total(self, touching: BoolArray) -> Any:
        """Return S for the points in contact, of the shape of the grid; 0 without contact."""
        touching = np.asarray(touching, dtype=bool)
        at = np.flatnonzero(touching)
        kind = complex if np.iscomplexobj(self._Z) else float
        x = np.zeros(at.size, kind) if self.density is None else self.density[touching].astype(kind)
        total, x, self.iterations = _sum_of_solution(
            lambda values: _filtered(self._Z, values, at, touching.shape),
            lambda values: _filtered(self._K, values, at, touching.shape),
            x,
            self._tolerance,
        )
        self.density = np.zeros(touching.shape, kind)
        self.density[touching] = x
        return total * self._cell


def attracted(
    stiffness: Field, curvature: FloatArray, touching: BoolArray, cell: float, tolerance: float = TOLERANCE
) -> Any:
    """Return S for points in contact beside others that attract; arrays of the shape of the grid.

    `stiffness` is K at the waves of a real transform, `curvature` d^2w/dg^2 of the interface at the points,
    `cell` the area of a grid cell. Raises ArithmeticError if no solution is found.
    """
    free = np.flatnonzero(~touching)
    shape, mean, number = touching.shape, np.ravel(stiffness)[0], touching.size
    softest = np.abs(np.where(stiffness == 0, np.inf, stiffness)).min()
    inverted = 1 / np.where(stiffness == 0, softest, stiffness)
    of_free = curvature.ravel()[free]
    kind = complex if np.iscomplexobj(stiffness) else float
    total, _, _ = _sum_of_solution(
        lambda values: _filtered(stiffness, values, free, shape) + of_free * values,
        lambda values: _filtered(inverted, values, free, shape),
        np.zeros(free.size, kind),
        tolerance,
    )
    if mean:
        return mean * (number - mean * total) * cell
    return number * number / total * cell if free.size else math.inf


def _sum_of_solution(
    apply: Callable[[Field], Field], precondition: Callable[[Field], Field], x: Field, tolerance: float
) -> tuple[Any, Field, int]:
    """Return the sum of the solution x of A x = 1, x, and the iterations of conjugate gradients from x."""
    r = np.ones(x.size, x.dtype)
    if x.any():
        r -= apply(x)
    z = precondition(r)
    p, rz, iterations = z.copy(), r @ z, 0  # not conjugated: the operator is symmetric
    while x.size and abs(rz) > tolerance * abs(x.sum()):
        if iterations == _MOST_ITERATIONS:
            raise ArithmeticError(f"conductance or stiffness not found in {_MOST_ITERATIONS} iterations")
        Ap = apply(p)
        step = rz / (p @ Ap)
        x += step * p
        r -= step * Ap
        z = precondition(r)
        rz, before = r @ z, rz
        p = z + (rz / before) * p
        iterations += 1
    # The error of x.b + x.r is of second order in that of x.
    return x.sum() + x @ r, x, iterations


def _filtered(H: Field, values: Field, at: NDArray[np.int64], shape: tuple[int, ...]) -> Field:
    """Apply a filter to values at some points; return it there."""
    parts = (values.real, values.imag) if np.iscomplexobj(values) else (values,)
    spectra = []
    for part in parts:
        field = np.zeros(math.prod(shape))
        field[at] = part
        spectra.append(fft.rfftn(field.reshape(shape)))
    if len(parts) == 1:
        return np.asarray(fft.irfftn(H * spectra[0], shape).ravel()[at])
    (a, b), h = spectra, np.asarray(H)
    real = fft.irfftn(h.real * a - h.imag * b, shape).ravel()[at]
    return np.asarray(real + 1j * fft.irfftn(h.real * b + h.imag * a, shape).ravel()[at])
