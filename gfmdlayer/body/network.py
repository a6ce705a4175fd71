"""A stack of layers as a network of springs and dashpots, reduced to the displacement of its surface.

Poisson's ratios do not relax, so each of the springs of `springs` has the modulus k G(s) of its layer. A
Prony solid stretched by e is a spring of its glassy modulus in series with Kelvin elements, one for each
retardation time theta_j and compliance J_j of its law, 1/G(s) = 1/Ginf + sum_j J_j/(1 + s theta_j). With the
elongation eta_j = xi_j sqrt(J_j/k) of each element the energy is

    k Ginf/2 (e - sum_j eta_j)^2 + 1/2 sum_j xi_j^2,          dissipation 1/2 sum_j theta_j (d xi_j/dt)^2.

The strains e are linear in the displacement u of the surface and in those of the interfaces, which follow
without inertia. Once they are eliminated, the body is, besides the free surface layer (its stiffness times
the layer's modulus),

    energy 1/2 |g u - B xi|^2 + 1/2 |xi|^2,       (1 + B^T B) xi + theta d(xi)/dt = B^T g u

with one row of B for each redundant spring. The internal vector xi is the state of the body, whatever its
temperature: a shift of a layer's times multiplies its theta_j, and nothing else. At constant times the
symmetric eigenproblem theta^(-1/2) (1 + B^T B) theta^(-1/2) v = v/theta' gives the relaxing modes.

The displacements are eliminated by an exchange of unknowns (Gauss-Jordan), from the base up and at each
interface first the normal one (else digits are lost where layers are thin and incompressible): each becomes
the strain of the spring that resists it most, and the other springs' strains are combinations N e + n u of
these. Weighted with the roots of the stiffnesses, N -> M, n -> m, the entries of M are of order one and of
full relative accuracy, for stiffnesses that differ by any factor; with L L^T = 1 + M M^T, g = L^-1 m, and B
has the columns of L^-1 (-M, 1) times sqrt(Ginf J_j). Nothing is subtracted: 1/theta' is found as the squared
singular values of (1; B) theta^(-1/2), by Jacobi rotations (LAPACK's dgejsv), to high relative
accuracy over any range of times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.body.materials import Material
from gfmdlayer.body.relaxation import Spectrum, VectorSpectrum, distinct_branches, retardation_spectrum
from gfmdlayer.body.springs import Springs
from gfmdlayer.validation.problems import ConfigError


@dataclass(frozen=True)
class Network:
    """The internal variables of a stack at wavenumbers q: (1 + B^T B) xi + theta d(xi)/dt = B^T g u.

    The surface stiffness is K(q, s) = free G_1(s) + g.g - g.B (1 + B^T B + s theta)^-1 B^T g, with the
    modulus G_1 of the uppermost layer.
    """

    free: FloatArray  # (nq,): stiffness of only the uppermost layer, for a unit modulus
    force: FloatArray  # g, (nq, redundant), or (nq, redundant, n) for n displacements of the surface
    projection: FloatArray  # P, (nq, redundant, springs): L^-1 (-M, 1)
    stiffness: FloatArray  # (nq, springs): roots of the glassy stiffnesses
    spring: IntArray  # (internal,): the spring that has this Kelvin element; those of a spring stand together
    roots: FloatArray  # c_j = sqrt(Ginf J_j), (internal,): the columns of B are those of P times c
    times: FloatArray  # (internal,): retardation times theta_j of the materials
    layer: IntArray  # (internal,): the layer whose material has this time, counted from the surface

    @cached_property
    def coupling(self) -> FloatArray:
        """B, (nq, redundant, internal)."""
        return self.projection[:, :, self.spring] * self.roots

    def modes(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Return weights w_j >= 0 and times of the modes besides `free` at one wavenumber, fastest first."""
        levers, times = _levers(self.force[i], self.coupling[i], self.times)
        return levers**2, times


class InternalVariables(NamedTuple):
    """The internal variables of a body whose layers may have reduced times of their own, at wavenumbers q."""

    uppermost: Spectrum  # the uppermost layer, parallel to the network; the body where that is negligible
    network: Network  # the other internal variables, at different wavenumbers where they are not negligible
    number: IntArray  # (nq,): place of each q in the network; -1 where the network is negligible
    laws: tuple[int, ...]  # for each layer of the network the number of its law, counted from the surface


def vector_spectrum(force: NDArray[Any], coupling: FloatArray, times: FloatArray) -> VectorSpectrum:
    """Return the modes of a network on which n displacements of the surface act."""
    # K(s) = g^H g - g^H B (1 + B^T B + s theta)^-1 B^T g, so that K_0 = g^H (1 + B B^T)^-1 g, with
    # `force` g, real or complex, (nq, redundant, n), `coupling` B (nq, redundant, internal), `times` theta
    # (internal,).
    softened = np.eye(force.shape[1]) + coupling @ np.swapaxes(coupling, 1, 2)
    relaxed = np.swapaxes(force, 1, 2).conj() @ np.linalg.solve(softened, force)
    modes = [_levers(*network, times) for network in zip(force, coupling, strict=True)]
    return VectorSpectrum(
        relaxed,
        np.stack([levers.T for levers, _ in modes], axis=1),
        np.stack([times_of_modes for _, times_of_modes in modes], axis=1),
    )


def _levers(force: NDArray[Any], coupling: FloatArray, times: FloatArray) -> tuple[NDArray[Any], FloatArray]:
    """Return the roots of the weights, (modes,) or (n, modes), and the times of the modes, fastest first."""
    if not times.size or not len(force):
        return np.zeros((*force.shape[1:], 0)), np.zeros(0)
    vectors, times_of_modes = mode_vectors(coupling, times)
    return force.conj().T @ vectors[times.size :], times_of_modes


def mode_vectors(coupling: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the vectors of the modes, (internal + redundant, modes), and their times, fastest first."""
    # They are the left singular vectors of (1; B) theta^(-1/2): the right ones, over columns of lengths that
    # differ by decades, would lose digits.
    system = np.vstack((np.eye(times.size), coupling)) / np.sqrt(times)
    slowness, vectors = singular_values(system[:, np.argsort(times)], left=True)
    return vectors, 1 / slowness**2


def singular_values(system: FloatArray, *, left: bool = False) -> tuple[FloatArray, FloatArray]:
    """Singular values, from the largest, and right singular vectors or left ones, by Jacobi rotations."""
    # They are of high relative accuracy for a matrix of columns of any lengths, well conditioned but for
    # those.
    from scipy.linalg.lapack import dgejsv

    wanted = {"joba": 0, "jobu": 0, "jobv": 3} if left else {"joba": 2, "jobu": 3, "jobv": 0}
    values, u, v, scale, *_, info = dgejsv(system, **wanted)
    if info:
        raise ArithmeticError(f"no convergence to the relaxing modes of a stack (dgejsv: {info})")
    return values * (scale[0] / scale[1]), u if left else v


class Member(NamedTuple):
    """The springs of one layer or halfspace, and its material."""

    springs: Springs  # for a unit modulus
    material: Material
    first: int  # the first of the displacements that strain them
    # of each displacement of the surface at q = 0: that of the layer alone per traction, for a unit modulus;
    # 0: ignored
    uniform: tuple[float, ...]


def assemble(
    members: Sequence[Member],
    free: FloatArray,
    q: FloatArray,
    displacements: int,
    *,
    surface: int = 1,
    interface: int = 2,
) -> Network:
    """Eliminate the displacements of the interfaces, and give each spring the elements of its material."""
    # `members` stand from the surface down, `free` (nq,) is the stiffness of the uppermost layer alone for a
    # unit modulus. Of the displacements, `surface` ones are of the surface, and `interface` of each interface
    # that moves. The network has one force g for each of the surface: (nq, redundant, surface), or (nq,
    # redundant) for a single one.
    if not members:
        none, index = np.zeros((q.size, 0)), np.empty(0, dtype=np.intp)
        return Network(free, none, np.zeros((q.size, 0, 0)), none, index, none[0], none[0], index)
    owner = np.repeat(np.arange(len(members)), [member.springs.stiffness.shape[1] for member in members])
    strains = np.zeros((q.size, owner.size, displacements))
    for i, member in enumerate(members):
        of, first = member.springs.strains, member.first
        inside = min(of.shape[2], displacements - first)  # a rigid base does not move
        strains[:, owner == i, first : first + inside] = of[:, :, :inside]
    glassy = np.array([member.material.glassy for member in members])[owner]
    stiffness = np.concatenate([member.springs.stiffness for member in members], axis=1)
    firsts = range(displacements - interface, surface - 1, -interface)
    from_below = [first + i for first in firsts for i in range(interface)]
    weights = np.sqrt(stiffness * glassy * np.where(q > 0, q, 1)[:, None])
    force, projection = redundants(strains, weights, from_below)
    mean = q == 0
    force[mean], projection[mean], weights[mean] = 0.0, 0.0, 1.0
    one_each = np.searchsorted(owner, np.arange(len(members)))
    for way, uniform in enumerate(np.array([member.uniform for member in members]).T):
        if mean.any() and uniform.any():  # springs in series, of each layer another one for each way
            whole = 1 / (uniform / glassy[one_each]).sum()
            force[mean, way, way] = np.sqrt(whole)
            for i, compliance in zip(one_each, uniform, strict=True):
                projection[mean, way, i + way] = np.sqrt(whole * compliance / glassy[i])
                weights[mean, i + way] = np.sqrt(glassy[i] / compliance) if compliance else 1.0
    known = [_kelvin(member.material) for member in members]
    elements = np.array([known[layer][0].size for layer in owner])
    return Network(
        free,
        force[:, :, 0] if surface == 1 else force,
        projection,
        weights,
        np.repeat(np.arange(elements.size), elements),
        np.concatenate([known[layer][0] for layer in owner]),
        np.concatenate([known[layer][1] for layer in owner]),
        np.repeat(owner, elements),
    )


def _kelvin(material: Material) -> tuple[FloatArray, FloatArray]:
    """Roots of Ginf J_j, and theta_j."""
    moduli, times = distinct_branches(material)
    if not moduli.size:
        return moduli, times
    if not material.relaxed:
        raise ConfigError(["body: a layer of a stack has G0 = 0, and its modes no end; must be > 0"])
    compliances, thetas = retardation_spectrum(moduli, times, np.array([material.relaxed]))
    return np.sqrt(material.glassy * compliances[:, 0]), thetas[:, 0]


def redundants(
    strains: FloatArray, weights: FloatArray, from_below: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return g and L^-1 (-M, 1) for strains over (surface, interfaces) and roots of the stiffnesses."""
    # `from_below` are the displacements to be eliminated, in this order; those of the surface come first.
    table, (count, springs, columns) = strains.copy(), strains.shape
    every = np.arange(count)
    free = np.ones((count, springs), dtype=bool)
    surface = columns - len(from_below)
    basis = np.empty((count, columns - surface), dtype=np.intp)
    for j in from_below:
        pivot = np.argmax(np.where(free, np.abs(table[:, :, j]) * weights, -1.0), axis=1)
        row = table[every, pivot] / table[every, pivot, j, np.newaxis]
        row[:, j] = -1 / table[every, pivot, j]
        factor = table[:, :, j].copy()
        table[:, :, j] = 0.0
        table -= factor[:, :, np.newaxis] * row[:, np.newaxis]
        free[every, pivot], basis[:, j - surface] = False, pivot
    rest = np.argsort(~free, axis=1, kind="stable")[:, : springs - columns + surface]
    at = every[:, np.newaxis]
    combined = table[at, rest] * weights[at, rest][:, :, np.newaxis]
    ratios = combined[:, :, surface:] / weights[at, basis][:, np.newaxis]
    identity = np.broadcast_to(np.eye(rest.shape[1]), (count, rest.shape[1], rest.shape[1]))
    lower = np.linalg.cholesky(identity + ratios @ np.swapaxes(ratios, 1, 2))
    reduced = np.linalg.solve(lower, np.concatenate((combined[:, :, :surface], -ratios, identity), axis=2))
    projection = np.zeros((count, rest.shape[1], springs))
    np.put_along_axis(
        projection, np.concatenate((basis, rest), axis=1)[:, np.newaxis], reduced[:, :, surface:], 2
    )
    return reduced[:, :, :surface], projection


def relaxation(instant: float, compliances: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the modes w_j, theta_j of K = 1/C with C = c_0 + sum_k c_k/(1 + s T_k), distinct T_k, (n,)."""
    # With v_k = (c_k/T_k)^(1/2), the rates 1/theta_j are the eigenvalues of diag(1/T) + v v^T/c_0, and
    # w_j = theta_j (e_j.v)^2/c_0^2 of its eigenvectors e_j. The instantaneous stiffness is 1/c_0.
    if not times.size:
        return times, times
    v = np.sqrt(compliances / times)
    system = np.vstack((np.diag(times**-0.5), v / math.sqrt(instant)))
    roots, vectors = singular_values(system)
    return ((v @ vectors) / (instant * roots)) ** 2, roots**-2
