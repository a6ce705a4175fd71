"""Displacements and stresses below the surface of layers that share one law, or are all elastic.

z points down, tension is positive. At a wave exp(i q.x), n = q/|q|: u_z = W, u_n = i U; s_zz, s_nz = i S,
s_nn, and s_tt across the wave. In a layer, for psi'' = psi(q z) and zeta = q z + const, in units of q G,

    U = psi,       W = psi',                s_zz = 2 psi,                    S = 2 psi',
    U = zeta psi,  W = zeta psi' - k psi,   s_zz = 2 zeta psi - 4 m psi',    S = 2 zeta psi' - 2 e psi,

    s_nn = -2 psi, s_tt = 0                 s_nn = -2 zeta psi - 4 nu psi',  s_tt = -4 nu psi'

with m = 1 - nu, e = 1 - 2 nu, k = 3 - 4 nu. The amplitudes follow from the strains a and forces b of the
springs between the faces of the layer (`springs`), never from differences of displacements: no digit is lost
in thin layers, and incompressible ones need no limit.

Where all layers relax alike, G_i(s) = r_i G(s), the displacements below follow at once from that of the
surface and the stresses from its pressure, whatever happened before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.network import redundants
from gfmdlayer.body.springs import halfspace_springs, layer_springs, surface_springs
from gfmdlayer.body.stack import LayerStack

# x = q d from which the free surface layer is a halfspace: the difference is below x exp(-2 x).
_DEEP = 40.0


class Waves(NamedTuple):
    """Fields at one depth for waves at the surface, each of the shape of q."""

    displacement: tuple[FloatArray, FloatArray]  # W, U for a displacement of the surface of one, downward
    stress: tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # s_zz, S, s_nn, s_tt for a pressure of one


class Inside:
    """The fields of a stack of elastic layers at wavenumbers q > 0.

    The law of a layer counts only by its relaxed modulus.
    """

    def __init__(self, stack: LayerStack, q: FloatArray) -> None:
        self.stack, self.q = stack, q
        self.tops = np.concatenate(([0.0], np.cumsum([layer.thickness for layer in stack.present])))
        top, *others = stack.present
        self.members = [halfspace_springs(q.size, top.poisson)]
        self.free = np.full(q.shape, 1 / (1 - top.poisson))
        if math.isfinite(top.thickness):
            self.members[0], self.free = surface_springs(q * top.thickness, top.poisson)
        for layer in others:
            deep = math.isinf(layer.thickness)
            x = q * layer.thickness
            self.members.append(
                halfspace_springs(q.size, layer.poisson) if deep else layer_springs(x, layer.poisson)
            )
        self.strains = self._strains()
        self.surface = stack.stiffness(q, 0.0)

    def _strains(self) -> list[FloatArray]:
        """Strains of the springs of each layer, (nq, springs), for a displacement of one of the surface."""
        present = self.stack.present
        if math.isinf(present[0].thickness):
            return [np.zeros((self.q.size, 0))]
        held = self.stack.rigid or math.isinf(present[-1].thickness)
        moving = 2 * len(present) + 1 - 2 * held
        counts = [springs.stiffness.shape[1] for springs in self.members]
        starts = np.cumsum([0, *counts])
        strains = np.zeros((self.q.size, starts[-1], moving))
        weights = np.empty((self.q.size, starts[-1]))
        for i, (springs, layer) in enumerate(zip(self.members, present, strict=True)):
            own, first = slice(starts[i], starts[i + 1]), max(2 * i - 1, 0)
            known = min(springs.strains.shape[2], moving - first)  # a rigid base does not move
            strains[:, own, first : first + known] = springs.strains[:, :, :known]
            weights[:, own] = np.sqrt(springs.stiffness * layer.material.relaxed)
        from_below = [first + i for first in range(moving - 2, 0, -2) for i in range(2)]
        force, projection = redundants(strains, weights, from_below)
        found = np.einsum("qrs,qr->qs", projection, force[:, :, 0]) / weights
        return [found[:, starts[i] : starts[i + 1]] for i in range(len(present))]

    def at(self, depth: float, number: int) -> Waves:
        """Return the fields at a depth in the layer of this number, counted from the surface."""
        layer, a = self.stack.present[number], self.strains[number].T
        b = self.members[number].stiffness.T * a if a.size else a
        z, x = self.q * (depth - self.tops[number]), self.q * layer.thickness
        if number and math.isinf(layer.thickness):
            found = _below(layer.poisson, z, a, b)
        elif number:
            found = _between(layer.poisson, z, x, a, b)
        else:
            found = _uppermost(layer.poisson, z, x, a, b)
        W, U, *stress = found
        per_pressure = self.q * layer.material.relaxed / self.surface
        szz, S, snn, stt = (each * per_pressure for each in stress)
        return Waves((W, U), (szz, S, snn, stt))


def _waves(
    nu: float,
    zeta: FloatArray,
    simple: tuple[FloatArray, FloatArray, FloatArray],
    linear: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    """W, U, s_zz, S, s_nn, s_tt of the two solutions, each with its amplitude, psi and psi'."""
    m, e, k = 1 - nu, 1 - 2 * nu, 3 - 4 * nu
    a0, f0, s0 = simple
    a1, f1, s1 = linear
    return np.stack(
        (
            a0 * s0 + a1 * (zeta * s1 - k * f1),
            a0 * f0 + a1 * zeta * f1,
            2 * a0 * f0 + a1 * (2 * zeta * f1 - 4 * m * s1),
            2 * a0 * s0 + a1 * (2 * zeta * s1 - 2 * e * f1),
            -2 * a0 * f0 - a1 * (4 * nu * s1 + 2 * zeta * f1),
            -4 * nu * a1 * s1,
        )
    )


def _hyperbolic(zeta: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosh and sinh of zeta, over cosh y, for |zeta| <= y."""
    whole = 1 + np.exp(-2 * y)
    up, down = np.exp(zeta - y) / whole, np.exp(-zeta - y) / whole
    return up + down, up - down


def _below(nu: float, z: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """The halfspace below layers."""
    m, psi = 1 - nu, np.exp(-z)
    return _waves(nu, z, (a[1], psi, -psi), (-b[0] / (4 * m) - a[1] / (2 * m), psi, -psi))


def _between(nu: float, z: FloatArray, x: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """A layer below another one: a motion even about its middle plane, and an odd one."""
    m, k, y = 1 - nu, 3 - 4 * nu, x / 2
    zeta, T = z - y, np.tanh(y)
    c, s = _hyperbolic(zeta, y)
    even, odd = (4 * a[1] - b[0]) / (8 * m), (b[2] - 4 * a[3]) / (8 * m)
    one = _waves(nu, zeta, (a[1] - even * y * T, c, s), (even, s, c))
    return one + _waves(nu, zeta, (a[3] - odd * (y * T - k), s, c), (odd, c, s))


def _uppermost(nu: float, z: FloatArray, x: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """The uppermost layer: the free one whose surface moves by one, and a motion even about the surface."""
    m, e = 1 - nu, 1 - 2 * nu
    psi, amplitude = np.exp(-z), np.full(z.shape, -1 / (2 * m))
    deep = _waves(nu, z, (-e * amplitude, psi, -psi), (amplitude, psi, -psi))
    if np.isinf(x).all():
        return deep
    T, zeta = np.tanh(x), z - x
    c, s = _hyperbolic(zeta, x)
    amplitude = -1 / (2 * m * (T + x / np.cosh(np.minimum(x, _DEEP)) ** 2))
    D, C = amplitude * x * T, amplitude * (T + x)
    free = _waves(nu, zeta, (2 * m * D, c, s), (D, s, c)) + _waves(nu, zeta, (e * C, s, c), (C, c, s))
    c, s = _hyperbolic(z, x)
    even = (2 * a[1] - b[0]) / (4 * m)
    rest = _waves(nu, z, (a[1] - even * x * T, c, s), (even, s, c))
    return np.where(x > _DEEP, deep, free) + rest
