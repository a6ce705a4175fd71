"""Stacks: any number of viscoelastic layers on a halfspace, on a rigid base, or free at the bottom.

The stiffness K(q, s) of the surface follows from the impedance of the base, which is carried upwards by a
linear map of its minors through each layer (`springs.minors`); without shear traction K = q det Z/Z_UU. No
term overflows, and the result has nearly all digits from thin layers to thick ones and for any ratio of
moduli. Its relaxing modes belong to a network of springs and dashpots (`network`).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import BoolArray, FloatArray, IntArray
from gfmdlayer.body.layer import Layer
from gfmdlayer.body.network import (
    InternalVariables,
    Member,
    Network,
    assemble,
    singular_values,
    vector_spectrum,
)
from gfmdlayer.body.relaxation import (
    NEGLIGIBLE,
    Spectrum,
    TractionSpectrum,
    VectorSpectrum,
    distinct_branches,
)
from gfmdlayer.body.springs import (
    Springs,
    halfspace_minors,
    halfspace_springs,
    layer_springs,
    minors,
    shear_springs,
    surface_springs,
)
from gfmdlayer.body.wavevectors import Wavevectors

# Fewer relaxing modes, with a bound on the error of K that holds for all s: balanced truncation.
#
# With c_j = sqrt(w_j theta_j) the relaxing part of the stiffness is K - K_0 = s c.(1 + s theta)^-1 c, a
# symmetric system in 1/s. Its Gramian P_ij = c_i c_j/(theta_i + theta_j) has eigenvalues sigma_1 >= sigma_2
# >= ... that fall exponentially, the faster the more the times crowd. In the space U of the first r
# eigenvectors the system U^T theta U, U^T c is again symmetric and positive, so that its r modes have w >= 0,
# theta > 0; K_0 is unchanged; and (Glover, Int. J. Control 39 (1984) 1115-1193; Enns's bound)
#
#     |K(s) - K_r(s)| <= 2 (sigma_(r+1) + ... + sigma_n)            for all s of Re s >= 0.
#
# The bound is reached at s = inf (Liu and Anderson, Int. J. Control 50 (1989) 1379-1405).


def merged(weights: FloatArray, times: FloatArray, bound: float) -> tuple[FloatArray, FloatArray, float]:
    """Return fewer modes of the same relaxed stiffness, and the bound on the change of K that they reach."""
    # `bound` is the largest change allowed at any s of Re s >= 0; with 0 no mode changes.
    if not bound:  # eigenvalues that rounding makes negative would pass
        return weights, times, 0.0
    strengths = np.sqrt(weights * times)
    gramian = np.multiply.outer(strengths, strengths) / np.add.outer(times, times)
    values, vectors = np.linalg.eigh(gramian)  # ascending
    changes = 2 * np.cumsum(np.maximum(values, 0.0))
    left = int(np.searchsorted(changes, bound, side="right"))
    reached = float(changes[left - 1]) if left else 0.0
    if left in (0, weights.size):
        return (weights, times, 0.0) if left == 0 else (weights[:0], times[:0], reached)
    basis = vectors[:, left:]
    roots, directions = singular_values(np.sqrt(times)[:, np.newaxis] * basis)
    return ((strengths @ basis) @ directions) ** 2 / roots**2, roots**2, reached


# Powers of the modulus in the minors of the impedance.
_DEGREES = np.array([0, 1, 1, 1, 2])

# Minors of an infinite and of a vanishing impedance.
_RIGID, _FREE = np.array([0.0, 0.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0, 0.0])

# Wavenumbers whose networks are assembled at once.
_CHUNK = 512


class Bonded(Hashable, Protocol):
    """Layers bonded to one another, as `Layers` are."""

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers from the surface down; the last is infinitely thick where they lie on a halfspace."""
        ...

    @property
    def present(self) -> tuple[Layer, ...]:
        """Those that have a thickness."""
        ...

    @property
    def rigid(self) -> bool:
        """Whether the last layer is bonded to a rigid base; else a finite one is free below."""
        ...

    @property
    def accuracy(self) -> float:
        """Relative error of K(q, s) up to which modes are merged."""
        ...


def stiffness(body: Bonded, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
    """Return K(q, s), stress per displacement, see `Body`."""
    q, s = np.broadcast_arrays(np.asarray(waves, dtype=float), np.asarray(s))
    positive = np.where(q > 0, q, 1.0)
    vector = np.broadcast_to(_RIGID if body.rigid else _FREE, (*q.shape, 5))
    for layer in reversed(body.present):
        modulus = layer.material.laplace(s)[..., np.newaxis]
        liquid = modulus == 0  # in the end, a free surface to the layers above
        modulus = np.where(liquid, 1.0, modulus) ** _DEGREES
        if math.isinf(layer.thickness):
            vector = modulus * halfspace_minors(layer.poisson)
        else:
            matrix = minors(positive * layer.thickness, layer.poisson)
            vector = modulus * (matrix @ (vector / modulus)[..., np.newaxis])[..., 0]
        vector = np.where(liquid, _FREE, vector / np.abs(vector[..., 3:4]))
    scale = np.where(vector[..., 3] == 0, 1.0, vector[..., 3])  # zero, as vector[..., 4], on a liquid
    return np.where(q > 0, positive * (vector[..., 4] / scale), _confined(body, s))


def spectrum(body: Bonded, waves: Wavevectors | ArrayLike) -> Spectrum:
    """Return the relaxing modes at the wavevectors, of any shape.

    They are found once for each magnitude. Modes of the other layers than the uppermost have weight zero
    where their weights sum to no more than `NEGLIGIBLE` of the relaxed stiffness, and are merged to the
    `accuracy` of the stack.
    """
    q = np.asarray(waves, dtype=float)
    different, where = np.unique(q, return_inverse=True)
    modes = _spectrum(body, different.tobytes())
    parts = (modes.relaxed, modes.weights, modes.times)
    relaxed, weights, times = (values[..., where.reshape(q.shape)] for values in parts)
    return Spectrum(relaxed, weights, times, modes.error)


def network_of(body: Bonded, q: ArrayLike) -> Network:
    """Return the network of springs and dashpots at the wavenumbers q, shape (nq,)."""
    q = np.asarray(q, dtype=float)
    members, free = members_of(body, np.where(q > 0, q, 1.0))
    finite = sum(math.isfinite(layer.thickness) for layer in body.present)
    return assemble(members, free * q, q, 2 * (finite + (not body.rigid)) - 1)


def traction_spectrum(body: Bonded, waves: Wavevectors | ArrayLike) -> TractionSpectrum:
    """Return the relaxing modes under tractions in all directions, at wavevectors of any shape.

    The modes are those of the network of `spectrum` in which the surface keeps both of its displacements.
    Where the uppermost layer is deep, they are the branches of its material on a halfspace. The mean of
    a tangential displacement is fixed but on a rigid base, where the layers are sheared in series.
    """
    q = np.asarray(waves, dtype=float)
    different, where = np.unique(q, return_inverse=True)
    plane, across = (modes.spectrum for modes in _traction_spectrum(body, different.tobytes()))
    at = where.reshape(q.shape)
    return TractionSpectrum(
        VectorSpectrum(plane.relaxed[at], plane.vectors[:, at], plane.times[:, at]),
        Spectrum(across.relaxed[at, 0, 0], across.vectors[:, at, 0] ** 2, across.times[:, at]),
    )


def internal_variables(body: Bonded, waves: Wavevectors | ArrayLike) -> InternalVariables:
    """Return the internal variables of all layers at the wavevectors, of any shape."""
    q = np.ravel(np.asarray(waves, dtype=float))
    moduli, times = distinct_branches(body.present[0].series)
    _, free = members_of(body, np.where(q > 0, q, 1.0))
    rows = np.repeat(times[:, np.newaxis], q.size, axis=1)
    different, where = np.unique(q, return_inverse=True)
    network, number = _coupled(body, different)
    own = body.present[0].series.relaxed * free * q
    relaxed = np.where(number[where] >= 0, own, stiffness(body, q, 0.0))
    uppermost = Spectrum(relaxed, np.multiply.outer(moduli, free * q), rows)
    laws = tuple(i for i, layer in enumerate(body.layers) if layer.thickness)
    return InternalVariables(uppermost, network, number[where], laws)


def _coupled(body: Bonded, q: FloatArray) -> tuple[Network, IntArray]:
    """Return the network where it is not negligible, and for each of the q its number there, or -1."""
    parts, numbers, count = [], np.full(q.size, -1, dtype=np.intp), 0
    for start in range(0, q.size, _CHUNK):
        some = q[start : start + _CHUNK]
        network = network_of(body, some)
        felt = (network.force**2).sum(axis=1) > NEGLIGIBLE * stiffness(body, some, 0.0)
        more = int(np.count_nonzero(felt))
        numbers[start : start + _CHUNK][felt] = count + np.arange(more)
        count += more
        rows = network.free, network.force, network.projection, network.stiffness
        parts.append([values[felt] for values in rows])
    free, force, projection, springs = (np.concatenate(values) for values in zip(*parts, strict=True))
    of_elements = network.spring, network.roots, network.times, network.layer
    return Network(free, force, projection, springs, *of_elements), numbers


def traction_springs(x: FloatArray, poisson: float, *, in_plane: bool) -> Springs:
    """Springs of a layer, x = q d > 0, over (W, U), or V, of its faces, or of its surface at x = inf."""
    if np.isinf(x).all():
        if in_plane:
            return halfspace_springs(x.size, poisson)
        return Springs(np.ones((x.size, 1, 1)), np.ones((x.size, 1)))
    return layer_springs(x, poisson) if in_plane else shear_springs(x)


def traction_network(body: Bonded, q: FloatArray, *, in_plane: bool) -> Network:
    """Return the network in which the surface moves by (W, U), or across the wave by V."""
    members, ways = [], 2 if in_plane else 1
    positive = np.where(q > 0, q, 1.0)
    for i, layer in enumerate(body.present):
        springs = traction_springs(positive * layer.thickness, layer.poisson, in_plane=in_plane)
        sheared = layer.thickness if body.rigid else 0.0
        uniform = (confined_compliance(body, layer), sheared) if in_plane else (sheared,)
        members.append(Member(springs, layer.series, ways * i, uniform))
    moving = sum(math.isfinite(layer.thickness) for layer in body.present) + (not body.rigid)
    network = assemble(members, np.zeros(q.size), q, ways * moving, surface=ways, interface=ways)
    return network if in_plane else replace(network, force=network.force[..., np.newaxis])


def members_of(body: Bonded, q: FloatArray) -> tuple[list[Member], FloatArray]:
    """Springs of each layer, and the stiffness in units of q of the uppermost layer alone."""
    top, *others = body.present
    if math.isinf(top.thickness):
        return [], np.full(q.shape, 1 / (1 - top.poisson))
    springs, free = surface_springs(q * top.thickness, top.poisson)
    members = [Member(springs, top.series, 0, (confined_compliance(body, top),))]
    for i, layer in enumerate(others, 1):
        if math.isinf(layer.thickness):
            springs = halfspace_springs(q.size, layer.poisson)
        else:
            springs = layer_springs(q * layer.thickness, layer.poisson)
        uniform = (confined_compliance(body, layer),)
        members.append(Member(springs, layer.series, 2 * i - 1, uniform))
    return members, free


def _confined(body: Bonded, s: NDArray[Any]) -> NDArray[Any]:
    """K(q = 0, s): of layers that are compressed one after the other and cannot widen."""
    parts = [(confined_compliance(body, layer), layer.material.laplace(s)) for layer in body.present]
    liquid = np.any([modulus == 0 for compliance, modulus in parts if compliance > 0], axis=0)
    total = np.asarray(sum(each / np.where(modulus == 0, 1.0, modulus) for each, modulus in parts))
    return np.asarray(np.where(liquid, 0.0, 1 / total)) if total.all() else np.zeros(np.shape(s))


def confined_compliance(body: Bonded, layer: Layer) -> float:
    """Compression of a layer by a uniform pressure, for a unit modulus; 0 where it moves as a whole."""
    if not body.rigid or layer.poisson == 0.5:
        return 0.0
    return layer.thickness * (1 - 2 * layer.poisson) / (2 * (1 - layer.poisson))


@lru_cache(maxsize=4)
def _spectrum(body: Bonded, wavenumbers: bytes) -> Spectrum:
    """Return the spectrum at different wavenumbers; the cases of a sweep mostly share it."""
    q = np.frombuffer(wavenumbers)
    relaxed = stiffness(body, q, 0.0)
    moduli, own_times = distinct_branches(body.present[0].series)
    own, local, error = [], [], 0.0
    for start in range(0, q.size, _CHUNK):
        network = network_of(body, q[start : start + _CHUNK])
        own.append(np.multiply.outer(moduli, network.free))
        for i, K in enumerate(relaxed[start : start + _CHUNK]):
            if network.force[i] @ network.force[i] > NEGLIGIBLE * K:
                weights, times = network.modes(i)
                some = weights * weights.size > NEGLIGIBLE * K
                weights, times, change = merged(weights[some], times[some], body.accuracy * K)
                local.append((start + i, weights, times))
                error = max(error, change / K)
    count = max((weights.size for _, weights, _ in local), default=0)
    all_weights, all_times = np.zeros((count, q.size)), np.ones((count, q.size))
    for k, weights, times in local:
        all_weights[: weights.size, k], all_times[: weights.size, k] = weights, times
    own_rows = np.repeat(own_times[:, np.newaxis], q.size, axis=1)
    weights = np.concatenate((np.concatenate(own, axis=1), all_weights))
    return Spectrum(relaxed, weights, np.vstack((own_rows, all_times)), error)


# Times its thickness the wavenumber above which a layer is a halfspace for tractions: (1 + x)^2 exp(-2x) is
# 1e-18 of the stiffness.
_DEEP = 24.0


def feels_only_the_top(body: Bonded, q: FloatArray) -> BoolArray:
    """Whether tractions at these wavenumbers feel the uppermost layer as a halfspace."""
    top = body.present[0]
    return np.ones(q.size, dtype=bool) if math.isinf(top.thickness) else q * top.thickness > _DEEP


def traction_networks(
    body: Bonded, q: FloatArray, *, in_plane: bool
) -> Iterator[tuple[NDArray[np.intp], Network]]:
    """Yield the networks of the other waves with their numbers, some waves at a time."""
    shallow = np.flatnonzero(~feels_only_the_top(body, q))
    for start in range(0, shallow.size, _CHUNK):
        some = shallow[start : start + _CHUNK]
        yield some, traction_network(body, q[some], in_plane=in_plane)


class NumberedModes(NamedTuple):
    """The modes of a network at all wavenumbers, fastest first, and their numbers there."""

    spectrum: VectorSpectrum
    numbers: NDArray[np.intp]  # of the modes that are not negligible at all wavenumbers


@lru_cache(maxsize=4)
def _traction_spectrum(body: Bonded, wavenumbers: bytes) -> tuple[NumberedModes, NumberedModes]:
    """Return the modes over (W, U) and over V at different wavenumbers."""
    q = np.frombuffer(wavenumbers)
    return _traction_modes(body, q, in_plane=True), _traction_modes(body, q, in_plane=False)


def mode_numbers(body: Bonded, q: FloatArray, *, in_plane: bool) -> NDArray[np.intp]:
    """Return the numbers in the network of the modes of `traction_spectrum` at different wavenumbers."""
    return _traction_spectrum(body, q.tobytes())[0 if in_plane else 1].numbers


def _traction_modes(body: Bonded, q: FloatArray, *, in_plane: bool) -> NumberedModes:
    """Join the modes of the network with those of waves that only the uppermost layer feels."""
    # On a deep layer each branch has a mode for each spring of a halfspace, in this order.
    top, ways = body.present[0], 2 if in_plane else 1
    deep = feels_only_the_top(body, q)
    springs = traction_springs(np.array([math.inf]), top.poisson, in_plane=in_plane)
    rows = np.sqrt(springs.stiffness[0])[:, np.newaxis] * springs.strains[0]
    moduli, times = distinct_branches(top.series)
    relaxed = np.multiply.outer(q * top.series.relaxed, rows.T @ rows)
    own = np.sqrt(np.multiply.outer(moduli, q[deep]))[:, np.newaxis, :, np.newaxis] * rows[:, np.newaxis]
    own_times = np.repeat(times, ways)[:, np.newaxis]
    parts = [(np.flatnonzero(deep), own.reshape(own_times.size, np.count_nonzero(deep), ways), own_times)]
    for some, network in traction_networks(body, q, in_plane=in_plane):
        modes = vector_spectrum(network.force, network.coupling, network.times)
        relaxed[some] = modes.relaxed
        parts.append((some, modes.vectors, modes.times))
    count = max(len(of_waves) for _, of_waves, _ in parts)
    vectors, all_times = np.zeros((count, q.size, ways)), np.ones((count, q.size))
    for at, of_waves, of_modes in parts:
        vectors[: len(of_waves), at], all_times[: len(of_waves), at] = of_waves, of_modes
    limit = NEGLIGIBLE * np.trace(relaxed, axis1=1, axis2=2)
    felt = ((vectors**2).sum(axis=2) > limit).any(axis=1)
    return NumberedModes(VectorSpectrum(relaxed, vectors[felt], all_times[felt]), np.flatnonzero(felt))
