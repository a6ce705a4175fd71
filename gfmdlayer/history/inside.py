"""Displacements and stresses below the surface on the periodic grid, from the surface and its history.

Strains and forces of the springs between the faces of the layers (`body.inside`) determine all fields. They
are linear in the displacement of the surface and in the stretches of its modes, wave by wave. Where the
layers relax alike, displacement and pressure of the surface are enough.

z points down, tension is positive. On a surface u_x = i n_x U, s_xx = n_x^2 s_nn + n_y^2 s_tt,
s_xy = n_x n_y (s_nn - s_tt), s_xz = i n_x S; a line is in plane strain, s_yy = s_tt. Transforms are not
normalised (`grid.transforms`). Fields that are odd along an axis have no wave at its largest wavenumber,
since the two waves +q and -q are one there. The mean is that of layers which cannot widen.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.inside import StackFields, alike
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.relaxation import Spectrum, distinct_branches
from gfmdlayer.body.solid import LayerDepth
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.modes import Modes
from gfmdlayer.history.stack_modes import StackModes
from gfmdlayer.kernels import kernel

_LEAST = 1e-100  # stress of which the cube is a number
_CHUNK = 4096  # waves whose stretches are summed at once

# Fields on a line, and on a surface: displacements along x, y, z and stresses.
LINE = ("x", "z", "xx", "yy", "zz", "xz")
SURFACE = ("x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")

_ODD_IN_Z = frozenset(("z", "xz", "yz"))  # which change their sign in a mirror z -> -z
STRESSES = frozenset(name for name in SURFACE if len(name) == 2)


class SpringFields(NamedTuple):
    """Transforms of the strains and the forces of all springs, downward, (springs, nq)."""

    strains: ComplexArray
    forces: ComplexArray


class Interior(ABC):
    """The fields below the surface of layers on the whole periodic grid, at these places."""

    def __init__(self, body: Layers, grid: Grid, places: Sequence[LayerDepth]) -> None:
        self.body, self.grid, self.places = body, grid, places
        self.relaxes_alike = alike([layer.material for layer in body.present])
        self._at_mean = np.flatnonzero(np.ravel(grid.wavenumbers) == 0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields: one letter for a displacement, two for a stress."""
        return LINE if len(self.grid.points) == 1 else SURFACE

    @abstractmethod
    def springs(self, history: Any, tractions: ComplexArray) -> SpringFields:
        """Return the springs after the last step of a history, and for transforms of the tractions."""

    @abstractmethod
    def of_surface(self, u: ComplexArray | None, p: ComplexArray) -> SpringFields:
        """Return the springs of layers that relax alike, of transforms of displacement and traction."""

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of rows of `SpringFields`."""

    @property
    def kept(self) -> int:
        """Number of fields in which a snapshot keeps strains or forces."""
        return self.rows

    @property
    @abstractmethod
    def keeps_springs(self) -> bool:
        """Whether only the springs of a snapshot determine the fields at other depths."""

    @abstractmethod
    def at(
        self, springs: SpringFields, place: LayerDepth, names: Collection[str] | None = None
    ) -> dict[str, FloatArray]:
        """Return the fields at a place by name, each of the grid's shape; default: all fields."""

    def recorded(self, springs: SpringFields) -> dict[str, NDArray[Any]]:
        """Return the fields of a snapshot, (places, *grid), and where they are needed the springs."""
        shape = len(self.places), *self.grid.shape
        recorded: dict[str, NDArray[Any]] = {
            named(name): np.empty(shape, np.float32) for name in (*self.names, "von_mises")
        }
        for i, place in enumerate(self.places):
            fields = self.at(springs, place)
            fields["von_mises"] = von_mises(fields)
            for name, field in fields.items():
                recorded[named(name)][i] = field
        if self.keeps_springs:
            for quantity, values in zip(("strain", "force"), springs, strict=True):
                recorded[f"spring_{quantity}"] = self._kept(values)
        return recorded

    def recalled(self, strains: FloatArray, forces: FloatArray) -> SpringFields:
        """Return the springs that a snapshot has recorded."""
        return SpringFields(self._recalled(strains), self._recalled(forces))

    def _kept(self, values: ComplexArray) -> FloatArray:
        """Return the fields of values of the springs, (springs, modes)."""
        shape = self.grid.spectral_shape
        return np.array([self.grid.from_waves(one.reshape(shape).copy()) for one in values])

    def _recalled(self, fields: FloatArray) -> ComplexArray:
        """Return the values of the springs from their fields."""
        axes = tuple(range(1, fields.ndim))
        return np.asarray(np.fft.rfftn(fields, axes=axes).reshape(len(fields), -1))


class BodyInterior(Interior):
    """The fields in one body."""

    @abstractmethod
    def _spectra(self, springs: SpringFields, place: LayerDepth) -> ComplexArray:
        """Return the transforms of the fields at a place, in the order of the names, but for the mean."""

    @abstractmethod
    def _means(self, springs: SpringFields, depth: float) -> Mapping[str, ComplexArray]:
        """Return the means of displacements and of the stresses on planes z = const that are not zero."""

    def at(
        self, springs: SpringFields, place: LayerDepth, names: Collection[str] | None = None
    ) -> dict[str, FloatArray]:
        """Return the fields at a place of the body."""
        spectra = self._spectra(springs, place)
        if (at := self._at_mean).size:
            nu, means = self.body.present[place.layer].poisson, dict(self._means(springs, place.depth))
            means["xx"] = means["yy"] = nu / (1 - nu) * means["zz"]
            for name, spectrum in zip(self.names, spectra, strict=True):
                spectrum[at] = means.get(name, 0.0)
        shape = self.grid.spectral_shape
        return {
            name: self.grid.from_waves(spectrum.reshape(shape))
            for name, spectrum in zip(self.names, spectra, strict=True)
            if names is None or name in names
        }


class NormalInterior(BodyInterior):
    """The fields under pressure; `modes` is the `spectrum` of the integrator's body."""

    def __init__(
        self,
        body: Layers,
        grid: Grid,
        places: Sequence[LayerDepth],
        modes: Callable[[FloatArray], Spectrum] | None = None,
    ) -> None:
        super().__init__(body, grid, places)
        self._modes = modes
        waves = grid.waves
        size = np.ravel(waves.magnitude)
        different, where = np.unique(size, return_inverse=True)
        self._where: IntArray = where.ravel()
        self.inside = StackFields(body, different)
        axes = len(grid.points)
        q = np.stack([np.ravel(waves.qx), np.ravel(waves.qy)])[:axes]
        largest = np.pi * np.divide(grid.points, grid.period)[:, np.newaxis]
        self._n = q / np.where(size > 0, size, 1.0)
        self._odd = np.where(np.abs(q) < (1 - 1e-9) * largest, self._n, 0.0)

    @property
    def rows(self) -> int:
        """Number of rows of `SpringFields`."""
        return self.inside.layer.size

    @property
    def keeps_springs(self) -> bool:
        """Whether layers of different laws relax."""
        return not self.relaxes_alike

    def springs(self, history: Any, tractions: ComplexArray) -> SpringFields:
        """Return the springs after the last step of an integrator, and for this pressure."""
        if self.relaxes_alike:
            return self.of_surface(history.u, tractions)
        assert isinstance(history, Modes)
        return self.of_history(history, tractions)

    def of_surface(self, u: ComplexArray | None, p: ComplexArray) -> SpringFields:
        """Return the springs of layers that relax alike, for displacement (upward) and pressure."""
        assert u is not None
        strains, forces = (each[:, self._where] for each in self.inside.alike())
        return self._with_mean(SpringFields(strains * -u, forces * p), p)

    def of_history(self, integrator: Modes, p: ComplexArray) -> SpringFields:
        """Return the springs of layers that relax by different laws."""
        inside, u, y = self.inside, integrator.u, integrator.stretches
        springs = SpringFields(*(each[:, self._where] * -u for each in inside.relaxed))
        scale, every = (inside.q * inside.stiffness[0])[self._where], np.arange(u.size)
        network = isinstance(integrator, StackModes)
        moduli, taus = distinct_branches(inside.body.present[0].series)
        for k, (G, tau) in enumerate(zip(moduli, taus, strict=True)):
            times = np.full((inside.q.size, 1), tau)
            rows = np.full(times.shape, k) if network else self._nearest.rows(np.arange(len(times)), times)
            springs.forces[0] -= G * scale * _taken(y, rows[self._where], every)[:, 0]
        if isinstance(integrator, StackModes):
            xi, at = integrator.internal
            of_network = inside.of_internal(self._where[at], -u[at], -xi)
            springs.strains[1:, at], springs.forces[1:, at] = of_network
        else:
            self._add_memory(springs, y)
        return self._with_mean(springs, p)

    @cached_property
    def _nearest(self) -> _Nearest:
        assert self._modes is not None
        return _Nearest(self._modes(self.inside.q))

    @cached_property
    def _rows(self) -> IntArray:
        """Numbers of the modes of the memory."""
        return self._nearest.rows(self.inside.memory.waves, self.inside.memory.times)

    def _with_mean(self, springs: SpringFields, p: ComplexArray) -> SpringFields:
        """Keep the mean pressure as the force of the first spring, which has none of its own."""
        springs.forces[0, self._at_mean] = p[self._at_mean]
        return springs

    def _add_memory(self, springs: SpringFields, y: ComplexArray) -> None:
        """Add the parts of the stretches y, (modes, nq), where they count."""
        memory, rows = self.inside.memory, self._rows
        number = np.full(self.inside.q.size, -1)
        number[memory.waves] = np.arange(memory.waves.size)
        felt = number[self._where]
        every = np.flatnonzero(felt >= 0)
        for start in range(0, every.size, _CHUNK):
            at = every[start : start + _CHUNK]
            of = felt[at]
            stretch = _taken(y, rows[of], at)
            springs.strains[1:, at] -= np.einsum("nsm,nm->sn", memory.strains[of], stretch)
            springs.forces[1:, at] -= np.einsum("nsm,nm->sn", memory.forces[of], stretch)

    def _spectra(self, springs: SpringFields, place: LayerDepth) -> ComplexArray:
        depth, number = place
        own = self.inside.layer == number
        T = np.ascontiguousarray(np.moveaxis(self.inside.transfer(np.asarray(depth), number), 2, 0))
        spectra = np.empty((len(self.names), self._where.size), dtype=np.complex128)
        superpose(T, self._where, springs.strains[own], springs.forces[own], self._n, self._odd, spectra)
        return spectra

    def _means(self, springs: SpringFields, depth: float) -> Mapping[str, ComplexArray]:
        return {"z": self._sunk(springs, depth), "zz": -springs.forces[0, self._at_mean]}

    def _sunk(self, springs: SpringFields, depth: float) -> ComplexArray:
        """Return the mean displacement at a depth, downward."""
        at, inside = self._at_mean, self.inside
        down = springs.strains[0, at]
        for i, top, layer in zip(inside.firsts, inside.tops, inside.body.present, strict=False):
            if depth > top:
                down = down - min((depth - top) / layer.thickness, 1.0) * springs.strains[i, at]
        return np.asarray(down)


class PairInterior(Interior):
    """The fields in a body and its counterbody, which is above it: at z < 0, seen in a mirror.

    The rows of `SpringFields` are those of the body, and then those of the counterbody.
    """

    def __init__(self, own: Sequence[Interior]) -> None:
        super().__init__(own[0].body, own[0].grid, own[0].places)
        self._own = own

    @property
    def rows(self) -> int:
        """Number of rows of `SpringFields`."""
        return sum(own.rows for own in self._own)

    @property
    def keeps_springs(self) -> bool:
        """Whether those of a body are needed."""
        return any(own.keeps_springs for own in self._own)

    def springs(self, history: Any, tractions: ComplexArray) -> SpringFields:
        """Return the springs of both bodies, under their shared pressure and opposite shear tractions."""
        every = zip(self._own, history.bodies, _on_both(tractions), strict=True)
        return _stacked([own.springs(body, of) for own, body, of in every])

    def of_surface(self, u: ComplexArray | None, p: ComplexArray) -> SpringFields:
        """Return the springs for the displacements of both surfaces, each out of its body, (2, ...)."""
        every = zip(self._own, (None, None) if u is None else u, _on_both(p), strict=True)
        return _stacked([own.of_surface(part, of) for own, part, of in every])

    def at(
        self, springs: SpringFields, place: LayerDepth, names: Collection[str] | None = None
    ) -> dict[str, FloatArray]:
        """Return the fields at a place of one of the bodies."""
        (first, second), of_first = self._own, self._own[0].rows
        if place.layer >= 0:
            return first.at(SpringFields(*(each[:of_first] for each in springs)), place, names)
        fields = second.at(SpringFields(*(each[of_first:] for each in springs)), place.mirrored, names)
        return {name: -field if name in _ODD_IN_Z else field for name, field in fields.items()}

    def _kept(self, values: ComplexArray) -> FloatArray:
        of_first = self._own[0].rows
        both = zip(self._own, (values[:of_first], values[of_first:]), strict=True)
        return np.concatenate([own._kept(part) for own, part in both])

    def _recalled(self, fields: FloatArray) -> ComplexArray:
        first, second = self._own
        return np.vstack((first._recalled(fields[: first.kept]), second._recalled(fields[first.kept :])))


def _on_both(tractions: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the pressure, or pressure and shear tractions, on the body and on the counterbody."""
    if tractions.ndim == 1:
        return tractions, tractions
    return tractions, np.concatenate((tractions[:1], -tractions[1:]))


def _stacked(springs: Sequence[SpringFields]) -> SpringFields:
    """Return the rows of both bodies."""
    return SpringFields(*(np.vstack(rows) for rows in zip(*springs, strict=True)))


class _Nearest:
    """Numbers of the modes whose times are nearest to given ones: their stretches are those of the network.

    The modes of the body are those of the network, but for rounding and for modes without weight.
    """

    def __init__(self, spectrum: Spectrum) -> None:
        self._logs = np.where(spectrum.weights > 0, np.log(spectrum.times), np.inf)

    def rows(self, waves: IntArray, times: FloatArray) -> IntArray:
        """Return for times (n, m) at n of the waves the numbers of the modes; -1 where there are none."""
        numbers = np.full(times.shape, -1)
        if len(self._logs):
            for k in range(times.shape[1]):
                apart = np.abs(self._logs[:, waves] - np.log(times[:, k]))
                numbers[:, k] = np.where(np.isfinite(apart.min(axis=0)), apart.argmin(axis=0), -1)
        return numbers


def _taken(y: ComplexArray, rows: IntArray, at: IntArray) -> ComplexArray:
    """Return the stretches of these modes, (n, m), at n waves; zero for the number -1."""
    if not len(y):
        return np.zeros(rows.shape, dtype=np.complex128)
    return np.where(rows >= 0, y[rows, at[:, np.newaxis]], 0.0)


@kernel(reorder=True)
def superpose(
    transfer: FloatArray,
    column: IntArray,
    strains: ComplexArray,
    forces: ComplexArray,
    n: FloatArray,
    odd: FloatArray,
    spectra: ComplexArray,
) -> None:
    """Set the transforms of the fields, in the order of `LINE` or `SURFACE`."""
    # `transfer` has the shape (waves, 6, springs), `column` the numbers of the waves, (nq,); `n` and `odd`
    # are the directions of the waves, (axes, nq), the latter zero at the largest wavenumber of the axis.
    for i in range(column.size):
        T = transfer[column[i]]
        W = U = szz = S = snn = stt = 0j
        for j in range(len(strains)):
            e, f = strains[j, i], forces[j, i]
            W, U = W + T[0, j] * e, U + T[1, j] * e
            szz, S, snn, stt = szz + T[2, j] * f, S + T[3, j] * f, snn + T[4, j] * f, stt + T[5, j] * f
        along = 1j * odd[0, i]
        if len(n) == 1:
            spectra[0, i], spectra[1, i], spectra[2, i] = along * U, W, snn
            spectra[3, i], spectra[4, i], spectra[5, i] = stt, szz, along * S
        else:
            across, change = 1j * odd[1, i], snn - stt
            spectra[0, i], spectra[1, i], spectra[2, i] = along * U, across * U, W
            spectra[3, i], spectra[4, i] = stt + n[0, i] ** 2 * change, stt + n[1, i] ** 2 * change
            spectra[5, i], spectra[6, i] = szz, odd[0, i] * odd[1, i] * change
            spectra[7, i], spectra[8, i] = along * S, across * S


def named(name: str) -> str:
    """Return the name of a field in results."""
    return {1: f"displacement_{name}", 2: f"stress_{name}"}.get(len(name), name)


INVARIANTS = {
    "von_mises": "von Mises stress",
    "largest_shear": "largest shear stress",
    "shear_on_plane": "shear stress on planes of constant depth",
}


def von_mises(stress: Mapping[str, FloatArray]) -> FloatArray:
    """Return the von Mises stress (3 J2)^(1/2), of stresses by the names of their components."""
    xx, yy, zz = (stress[name] for name in ("xx", "yy", "zz"))
    a, b, c = xx - yy, yy - zz, zz - xx
    total = (a * a + b * b + c * c) / 6
    for name in ("xy", "xz", "yz"):
        if name in stress:
            total += stress[name] * stress[name]
    return np.asarray(np.sqrt(3 * total))


def largest_shear(stress: Mapping[str, FloatArray], equivalent: FloatArray) -> FloatArray:
    """Return half the largest difference of principal stresses; `equivalent` is the von Mises stress."""
    xx, yy, zz, xz = (np.ravel(stress[name]) for name in ("xx", "yy", "zz", "xz"))
    if "xy" not in stress:  # on a line the stress across it is principal
        half, radius = (xx + zz) / 2, np.hypot((xx - zz) / 2, xz)
        return np.maximum(radius, (np.abs(yy - half) + radius) / 2).reshape(equivalent.shape)
    shear, xy, yz = np.empty(equivalent.size), np.ravel(stress["xy"]), np.ravel(stress["yz"])
    half_of_principal(xx, yy, zz, xy, xz, yz, np.ravel(equivalent), shear)
    return shear.reshape(equivalent.shape)


@kernel
def half_of_principal(
    xx: FloatArray,
    yy: FloatArray,
    zz: FloatArray,
    xy: FloatArray,
    xz: FloatArray,
    yz: FloatArray,
    equivalent: FloatArray,
    shear: FloatArray,
) -> None:
    """Set half the difference of the principal stresses mean + 2/3 equivalent cos(angle + 2 pi k/3)."""
    for i in range(shear.size):
        mean, q = (xx[i] + yy[i] + zz[i]) / 3, equivalent[i]
        a, b, c = xx[i] - mean, yy[i] - mean, zz[i] - mean
        third = a * b * c + 2 * xy[i] * xz[i] * yz[i] - a * yz[i] ** 2 - b * xz[i] ** 2 - c * xy[i] ** 2
        cosine = min(max(13.5 * third / q**3, -1.0), 1.0) if q > _LEAST else 0.0
        shear[i] = q * math.sin((math.acos(cosine) + math.pi) / 3) / math.sqrt(3.0)


def shear_on_plane(stress: Mapping[str, FloatArray]) -> FloatArray:
    """Return the magnitude of the shear stress on planes of constant depth."""
    return np.hypot(stress["xz"], stress["yz"]) if "yz" in stress else np.abs(stress["xz"])


def invariants(stress: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the fields of `INVARIANTS`."""
    equivalent = von_mises(stress)
    every = equivalent, largest_shear(stress, equivalent), shear_on_plane(stress)
    return dict(zip(INVARIANTS, every, strict=True))
