"""Displacements and stresses below the surface of layers.

z points down, tension is positive. At a wave exp(i q.x), n = q/|q|: u_z = W, u_n = i U; s_zz, s_nz = i S,
s_nn, and s_tt across the wave. In a layer, for psi'' = psi(q z) and zeta = q z + const, in units of q G,

    U = psi,       W = psi',                s_zz = 2 psi,                    S = 2 psi',
    U = zeta psi,  W = zeta psi' - k psi,   s_zz = 2 zeta psi - 4 m psi',    S = 2 zeta psi' - 2 e psi,

    s_nn = -2 psi, s_tt = 0                 s_nn = -2 zeta psi - 4 nu psi',  s_tt = -4 nu psi'

with m = 1 - nu, e = 1 - 2 nu, k = 3 - 4 nu. The amplitudes follow from the strains a and forces b of the
springs between the faces of the layer (`springs`), never from differences of displacements: no digit is lost
in thin layers, and incompressible ones need no limit.

Poisson's ratios do not relax, so the displacements in a layer follow at once from the strains of its springs,
and the stresses from their forces, in which the memory of the modulus is:

    displacements:   a = strain,                  b = stiffness strain
    stresses/q:      a = force/(q stiffness),     b = force/q

Where all layers relax alike, G_i(s) = r_i G(s), the strains follow from the displacement of the surface and
the forces from its pressure, whatever happened before. Where they relax by different laws, strains and forces
are sums over the stretches y of the surface's modes. With the internal vector xi = X (u - y) of `network`, of
the modes' left singular vectors X, and e_0, f_0 of the relaxed stack,

    forces   f = f_0 u + sum_k f_k y_k,       f_k = w P^T B X_k,      w = (glassy stiffness)^(1/2)
    strains  e = e_0 u + sum_k e_k y_k,       e_k = f_k/w^2 - c X_k/w

and the spring of the free uppermost layer has the strain u and the force free (G0 u + sum_k G_k y_k).

Under shear traction the surface keeps both of its displacements: the uppermost layer has the springs of the
others, a halfspace those of one below layers, and (W, U) and the vectors of the modes take the place of u and
of their roots of weights. Across the wave u_t = i V, s_tz = i Z, s_nt, and in units of q G

    V = psi,       Z = psi',       s_nt = -psi.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.network import Network, mode_vectors
from gfmdlayer.body.relaxation import distinct_branches
from gfmdlayer.body.stack import (
    feels_only_the_top,
    members_of,
    mode_numbers,
    stiffness,
    traction_network,
    traction_networks,
    traction_springs,
)

# x = q d from which the free surface layer is a halfspace: the difference is below x exp(-2 x).
_DEEP = 40.0

# Relative to the stiffness of the surface: where the springs' part of it is smaller, their forces are below
# 1e-12 of the pressure, and their memory does not count.
_UNFELT = 1e-24


class Readout(NamedTuple):
    """Strains and forces of springs for a stretch of one of each of the surface's modes, downward."""

    waves: IntArray  # (n,): numbers of the q
    times: FloatArray  # (n, modes): retardation times
    strains: FloatArray  # (n, springs, modes)
    forces: FloatArray  # (n, springs, modes)


def alike(laws: Sequence[Law]) -> bool:
    """Whether layers of these laws relax alike: by one law, or not at all."""
    same = all(law == laws[0] for law in laws)
    return same or all(isinstance(law, Material) and law.elastic for law in laws)


class StackFields:
    """The fields of a stack at wavenumbers q >= 0, of the strains and forces of its springs.

    The springs stand in the order of the layers: that of the free uppermost layer, then those between the
    faces of each layer. Strains, forces and displacements are downward. At q = 0 the first spring between the
    faces of a layer is the layer itself (`firsts`): its strain is the compression, which is zero unless the
    layers are compressible and on a rigid base.
    """

    def __init__(self, body: Layers, q: FloatArray) -> None:
        self.body, self.q, positive = body, q, np.where(q > 0, q, 1.0)
        self.tops = np.concatenate(([0.0], np.cumsum([layer.thickness for layer in body.present])))
        members, free = members_of(body, positive)
        counts = [of.springs.stiffness.shape[1] for of in members]
        self.layer: IntArray = np.repeat(np.arange(len(counts) + 1), [1, *counts]) - 1
        self.layer[0] = 0
        self.firsts: IntArray = np.cumsum([1, *counts])[:-1]
        # For a modulus of one, over q.
        self.stiffness = np.vstack((free, *(of.springs.stiffness.T for of in members)))

    @cached_property
    def relaxed(self) -> tuple[FloatArray, FloatArray]:
        """Strains and forces of all springs, (springs, nq), for a relaxed surface that moves by one."""
        relaxed = self.body.with_series([Elastic(law.relaxed) for law in self.body.laws], 0.0)
        network = relaxed.network(self.q)
        forces = np.einsum("qrs,qr->qs", network.projection, network.force)
        free = network.free * self.body.present[0].material.relaxed
        strains = np.vstack((np.ones(self.q.size), (forces / network.stiffness).T))
        return strains, np.vstack((free, (forces * network.stiffness).T))

    def alike(self) -> tuple[FloatArray, FloatArray]:
        """Strains of all springs for a displacement, and forces for a pressure of one of the surface."""
        strains, forces = self.relaxed
        K = stiffness(self.body, self.q, 0.0)
        return strains, forces / np.where(K > 0, K, 1.0)

    @cached_property
    def _network(self) -> Network:
        return self.body.network(self.q)

    @cached_property
    def memory(self) -> Readout:
        """The memory of all springs but the first, at the q where it counts."""
        of, K = self._network, stiffness(self.body, self.q, 0.0)
        size, springs = of.times.size, of.stiffness.shape[1]
        felt = (of.force**2).sum(axis=1) > _UNFELT * K
        waves = np.flatnonzero(felt) if size else np.empty(0, dtype=np.intp)
        shapes = (size,), (springs, size), (springs, size)
        readout = Readout(waves, *(np.zeros((waves.size, *shape)) for shape in shapes))
        for k, i in enumerate(waves):
            coupling, w = of.projection[i][:, of.spring] * of.roots, of.stiffness[i][:, np.newaxis]
            vectors, readout.times[k] = mode_vectors(coupling, of.times)
            X = vectors[:size] * (of.force[i] @ vectors[size:])
            forces = of.projection[i].T @ (coupling @ X)
            stretched = np.zeros((springs, size))
            np.add.at(stretched, of.spring, of.roots[:, np.newaxis] * X)
            readout.strains[k], readout.forces[k] = (forces - stretched) / w, forces * w
        return readout

    def of_internal(
        self, waves: IntArray, u: ComplexArray, xi: ComplexArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return strains and forces of all springs but the first for internal vectors xi, (n, internal)."""
        # `waves` are the numbers of their q, and u the displacement of the surface, both (n,).
        of = self._network
        w, P = of.stiffness[waves], of.projection[waves]
        stretched = np.zeros(w.shape, dtype=np.complex128)
        np.add.at(stretched.T, of.spring, (xi * of.roots).T)
        e = of.force[waves] * u[:, np.newaxis] - np.einsum("nra,na->nr", P, stretched)
        forces = np.einsum("nra,nr->na", P, e)
        return ((forces + stretched) / w).T, (forces * w).T

    def transfer(self, depth: FloatArray, number: int) -> FloatArray:
        """Return the fields at a depth, in the layer of this number, for each of its springs."""
        # W and U for a strain of one, s_zz, S, s_nn and s_tt for a force of one: (6, springs, nq).
        infinite = math.isinf(self.body.present[number].thickness)
        form = _uppermost if not number else _below if infinite else _between
        return _of_each_spring(self, form, depth, number, 2)


class TractionFields:
    """The fields of a stack under tractions at wavenumbers q >= 0, of the strains and forces of its springs.

    In the plane of the wave the surface moves by (W, U) under (p, T), and each layer has four springs between
    its faces; across it by V under S, with three springs. A halfspace has two, and one. At q = 0 the springs
    of a layer on a rigid base from `firsts` on are the layer itself, one for each displacement.
    """

    def __init__(self, body: Layers, q: FloatArray, *, in_plane: bool) -> None:
        self.body, self.q, self.in_plane, self.ways = body, q, in_plane, 2 if in_plane else 1
        self.tops = np.concatenate(([0.0], np.cumsum([layer.thickness for layer in body.present])))
        positive = np.where(q > 0, q, 1.0)
        of = [
            traction_springs(positive * layer.thickness, layer.poisson, in_plane=in_plane)
            for layer in body.present
        ]
        counts = [each.stiffness.shape[1] for each in of]
        self.layer: IntArray = np.repeat(np.arange(len(counts)), counts)
        self.firsts: IntArray = np.cumsum([0, *counts])[:-1]
        self._uppermost = of[0]
        self.stiffness = np.vstack([each.stiffness.T for each in of])  # for a modulus of one, over q

    @cached_property
    def _relaxed(self) -> Network:
        relaxed = self.body.with_series([Elastic(law.relaxed) for law in self.body.laws], 0.0)
        return traction_network(relaxed, self.q, in_plane=self.in_plane)

    @cached_property
    def relaxed(self) -> tuple[FloatArray, FloatArray]:
        """Strains and forces of all springs, (ways, springs, nq), for a relaxed surface that moves by one."""
        of = self._relaxed
        forces, w = np.einsum("qrs,qrw->wsq", of.projection, of.force), of.stiffness.T
        return forces / w, forces * w

    @cached_property
    def compliance(self) -> FloatArray:
        """Displacements of the relaxed surface per traction, (nq, ways, ways); of a fixed mean zero."""
        of = self._relaxed
        K = np.swapaxes(of.force, 1, 2) @ of.force
        size = np.sqrt(np.einsum("qww->qw", K))  # the entries may differ by any factor
        free = size > 0
        scale = np.where(free, size, 1.0)
        scales, both = (each[:, :, np.newaxis] * each[:, np.newaxis] for each in (scale, free))
        whole = K / scales + np.eye(self.ways) * ~free[:, np.newaxis]
        return np.asarray(np.where(both, np.linalg.inv(whole) / scales, 0.0))

    @cached_property
    def loaded(self) -> FloatArray:
        """Forces of all springs for a traction of one, (ways, springs, nq), of layers that relax alike."""
        return np.asarray(np.einsum("vsq,qvw->wsq", self.relaxed[1], self.compliance))

    @cached_property
    def memory(self) -> tuple[FloatArray, FloatArray]:
        """Strains and forces of all springs, (nq, springs, modes), for a stretch of one of each mode."""
        # In a deep layer the motion of the surface is that of springs whose other face rests.
        numbers = mode_numbers(self.body, self.q, in_plane=self.in_plane)
        strains, forces = np.zeros((2, self.q.size, self.layer.size, numbers.size))
        for some, of in traction_networks(self.body, self.q, in_plane=self.in_plane):
            size = of.times.size
            kept = numbers[numbers < size]
            for k, i in enumerate(some if size else ()):
                vectors, _ = mode_vectors(of.coupling[k], of.times)
                X, w = vectors[:size, kept], of.stiffness[k][:, np.newaxis]
                if not self.in_plane:  # the modes across have weights, roots of which are positive
                    X = X * np.where(of.force[k][:, 0] @ vectors[size:, kept] < 0, -1.0, 1.0)
                force = of.projection[k].T @ (of.coupling[k] @ X)
                stretched = np.zeros(force.shape)
                np.add.at(stretched, of.spring, of.roots[:, np.newaxis] * X)
                strains[i, :, : kept.size], forces[i, :, : kept.size] = (force - stretched) / w, force * w
        top, deep = self.body.present[0], np.flatnonzero(feels_only_the_top(self.body, self.q))
        halfspace = traction_springs(np.array([math.inf]), top.poisson, in_plane=self.in_plane)
        moduli, _ = distinct_branches(top.series)
        own = self._uppermost.strains[deep, :, : self.ways] @ np.linalg.inv(halfspace.strains[0])
        own = own * self._uppermost.stiffness[deep][:, :, np.newaxis] / np.sqrt(halfspace.stiffness[0])
        per_mode = np.sqrt(moduli)[:, np.newaxis] * own[:, :, np.newaxis]
        per_mode = np.sqrt(self.q[deep])[:, np.newaxis, np.newaxis] * per_mode.reshape(
            *own.shape[:2], moduli.size * self.ways
        )
        kept = numbers[numbers < per_mode.shape[2]]
        forces[deep, : own.shape[1], : kept.size] = per_mode[:, :, kept]
        return strains, forces

    def transfer(self, depth: float, number: int) -> FloatArray:
        """Return the fields at a depth, in the layer of this number, for each of its springs."""
        # In the plane as `StackFields.transfer`; across V for a strain of one, Z and s_nt for a force of one:
        # (3, springs, nq).
        infinite = math.isinf(self.body.present[number].thickness)
        form = (_below if infinite else _between) if self.in_plane else _across
        return _of_each_spring(self, form, depth, number, self.ways)


def _of_each_spring(
    of: StackFields | TractionFields,
    form: Callable[..., FloatArray],
    depth: float | FloatArray,
    number: int,
    displacements: int,
) -> FloatArray:
    """Return the fields of a form, of which the first are displacements, for each spring of a layer."""
    layer, own = of.body.present[number], np.flatnonzero(of.layer == number)
    positive = np.where(of.q > 0, of.q, 1.0)
    z, x = positive * (depth - of.tops[number]), positive * layer.thickness
    of_springs = []
    for i in range(own.size):
        a = np.zeros((own.size, of.q.size))
        a[i] = 1.0
        stiffness = of.stiffness[own]
        fields = form(layer.poisson, z, x, a, stiffness * a)
        fields[displacements:] /= stiffness[i]
        of_springs.append(fields)
    return np.stack(of_springs, axis=1)


def _across(_nu: float, z: FloatArray, x: FloatArray, a: FloatArray, _b: FloatArray) -> FloatArray:
    """V, Z and s_nt in a layer, or in a halfspace, of springs across the wave."""
    if np.isinf(x).all():
        V = a[0] * np.exp(-z)
        return np.stack((V, -V, -V))
    c, s = _hyperbolic(z - x / 2, x / 2)
    T = np.tanh(x / 2)
    mean, difference = (a[1] + a[2]) / 2, -a[0] / (2 * T)
    V, Z = mean * c + difference * s, mean * s + difference * c
    return np.stack((V, Z, -V))


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


def _below(nu: float, z: FloatArray, _x: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
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
    """The uppermost layer: the free one whose surface moves, and a motion even about the surface."""
    m, e = 1 - nu, 1 - 2 * nu
    psi, amplitude = np.exp(-z), -a[0] / (2 * m)
    deep = _waves(nu, z, (-e * amplitude, psi, -psi), (amplitude, psi, -psi))
    if np.isinf(x).all():
        return deep
    T, zeta = np.tanh(x), z - x
    c, s = _hyperbolic(zeta, x)
    amplitude = -a[0] / (2 * m * (T + x / np.cosh(np.minimum(x, _DEEP)) ** 2))
    D, C = amplitude * x * T, amplitude * (T + x)
    free = _waves(nu, zeta, (2 * m * D, c, s), (D, s, c)) + _waves(nu, zeta, (e * C, s, c), (C, c, s))
    c, s = _hyperbolic(z, x)
    even = (2 * a[2] - b[1]) / (4 * m)
    rest = _waves(nu, z, (a[2] - even * x * T, c, s), (even, s, c))
    return np.where(x > _DEEP, deep, free) + rest
