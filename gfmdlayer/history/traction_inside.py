"""Displacements and stresses below a surface under pressure and shear traction, on the periodic grid.

Signs and means as in `history.inside`, waves as in `history.traction_modes`: W into the body, and u = i (n U
+ m V) along a wave n and across it, m = (-n_y, n_x); tractions on the body likewise (p, T, S). Then

    s_nz = i R,  s_tz = i Z,                             s_xz = i (n_x R + m_x Z),  s_yz = i (n_y R + m_y Z),
    s_xx = n_x^2 s_nn + n_y^2 s_tt - 2 n_x n_y s_nt,     s_yy = n_y^2 s_nn + n_x^2 s_tt + 2 n_x n_y s_nt,
    s_xy = n_x n_y (s_nn - s_tt) + (n_x^2 - n_y^2) s_nt.

At the largest wavenumber of an even axis +q and -q share a mode of the grid, and each has half of it: fields
that are odd along the axis vanish. At the mean U, V, T and S are u_x, u_y, t_x and t_y.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.inside import TractionFields, alike
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.materials import Elastic
from gfmdlayer.body.solid import LayerDepth
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.inside import BodyInterior, SpringFields
from gfmdlayer.history.traction_modes import TractionWaves
from gfmdlayer.kernels import kernel

_CHUNK = 4096  # waves whose stretches are summed at once


class TractionInterior(BodyInterior):
    """The fields under pressure and shear traction.

    The first rows of `SpringFields` are displacements (W, U[, V]) and tractions (p, T[, S]) of the surface.
    """

    def __init__(self, body: Layers, grid: Grid, places: Sequence[LayerDepth]) -> None:
        super().__init__(body, grid, places)
        self._waves, axes = TractionWaves(grid), len(grid.points)
        different, where = np.unique(np.ravel(grid.wavenumbers), return_inverse=True)
        self._where: IntArray = where.ravel()[self._waves.mode]
        self._parts = [TractionFields(body, different, in_plane=plane) for plane in (True, False)[:axes]]

    @property
    def rows(self) -> int:
        """Number of rows of `SpringFields`."""
        return self._first(len(self._parts))

    @property
    def kept(self) -> int:
        """Number of fields in which a snapshot keeps strains or forces."""
        others = 2 * self.rows * self.grid.ranks.total(int(np.count_nonzero(self._waves.share < 1)))
        return self.rows + math.ceil(others / self.grid.size)

    @property
    def keeps_springs(self) -> bool:
        """Whether a layer relaxes: the displacements along the surface then depend on the past."""
        return not alike([*(layer.material for layer in self.body.present), Elastic(1.0)])

    def springs(self, history: Any, tractions: ComplexArray) -> SpringFields:
        """Return the springs after the last step of a history, and for transforms of the tractions."""
        x, loads = self._in_phase([part.x for part in history.components]), self._components(tractions)
        if self.relaxes_alike:
            return self._of_surface(x, loads)
        strains: list[ComplexArray] = []
        forces: list[ComplexArray] = []
        stretches = self._in_phase([part.stretches.T for part in history.components])
        for part, moved, y in zip(self._parts, x, stretches, strict=True):
            for of, relaxed, past in zip((strains, forces), part.relaxed, part.memory, strict=True):
                of.append(np.einsum("wsq,qw->sq", relaxed[:, :, self._where], moved))
                for start in range(0, self._where.size, _CHUNK):
                    at = slice(start, start + _CHUNK)
                    of[-1][:, at] += np.einsum("nsm,nm->sn", past[self._where[at]], y[at])
        return SpringFields(_rows(x, strains), _rows(loads, forces))

    def of_surface(self, u: ComplexArray | None, p: ComplexArray) -> SpringFields:
        """Return the springs of layers that relax alike, for displacement (W, u_x[, u_y]) and tractions.

        Without displacements they are those of elastic layers.
        """
        loads = self._components(p)
        if u is not None:
            return self._of_surface(self._components(u), loads)
        every = zip(self._parts, loads, strict=True)
        x = [np.einsum("qwv,qv->qw", part.compliance[self._where], load) for part, load in every]
        return self._of_surface(x, loads)

    def _kept(self, values: ComplexArray) -> FloatArray:
        """Return the fields of the springs, and below them the values of the waves that share a mode."""
        # A field has one number for a mode. The others follow one by one, in as many fields as they fill, and
        # in the order of one process.
        grid, shared = self.grid, self._waves.share < 1
        modes = super()._kept(values[:, : grid.wavenumbers.size])
        order = np.concatenate(grid.ranks.all_of(self._waves.order[shared]))
        every = np.concatenate(grid.ranks.all_of(values[:, shared]), axis=1)
        others = np.ascontiguousarray(every[:, np.argsort(order)]).ravel().view(float)
        others = np.append(others, np.zeros(-others.size % grid.size))
        return np.concatenate((modes, others.reshape(-1, *grid.points)[:, grid.rows]))

    def _recalled(self, fields: FloatArray) -> ComplexArray:
        """Return the values of the springs on all waves."""
        count, shared = self.rows, self._waves.share < 1
        values = super()._recalled(fields[:count])[:, self._waves.mode]
        others = np.ascontiguousarray(fields[count:]).ravel()[: 2 * count * np.count_nonzero(shared)]
        values[:, shared] = others.view(complex).reshape(count, -1)
        return values

    def _of_surface(self, x: list[ComplexArray], loads: list[ComplexArray]) -> SpringFields:
        """Return the springs of layers that relax alike, for displacements and tractions on the waves."""
        every = list(zip(self._parts, x, loads, strict=True))
        strains, forces = (
            [np.einsum("wsq,qw->sq", values[:, :, self._where], of) for values, of in pairs]
            for pairs in (
                [(part.relaxed[0], moved) for part, moved, _ in every],
                [(part.loaded, load) for part, _, load in every],
            )
        )
        return SpringFields(_rows(x, strains), _rows(loads, forces))

    def _components(self, transforms: ComplexArray) -> list[ComplexArray]:
        """Return (W, U) and V, or (p, T) and S, on the waves, of transforms of vectors, (1 + axes, modes)."""
        return self._in_phase(self._waves.components(transforms))

    def _in_phase(self, parts: list[ComplexArray]) -> list[ComplexArray]:
        """Return values of the waves, (nq, n), of which those across are i times V; at the mean real ones."""
        found = [part * unit for part, unit in zip(parts, (1.0, -1j), strict=False)]
        for part in found:
            part[self._at_mean] = part[self._at_mean].real - part[self._at_mean].imag
        return found

    def _first(self, part: int) -> int:
        """Return the number of the first row of the springs in the plane or across, after those above."""
        return sum(each.ways for each in self._parts) + sum(each.layer.size for each in self._parts[:part])

    def _of(self, part: int, values: ComplexArray) -> ComplexArray:
        """Return the rows of the springs in the plane or across."""
        return values[self._first(part) : self._first(part + 1)]

    def _spectra(self, springs: SpringFields, place: LayerDepth) -> ComplexArray:
        depth, number = place
        different, every = self._parts[0].q.size, self._where.size
        transfers = [np.zeros((different, 6, 0)), np.zeros((different, 3, 0))]  # a line has none across
        rows = [SpringFields(*np.zeros((2, 0, every), dtype=np.complex128))] * 2
        for i, part in enumerate(self._parts):
            own = part.layer == number
            transfers[i] = np.ascontiguousarray(np.moveaxis(part.transfer(depth, number), 2, 0))
            rows[i] = SpringFields(*(self._of(i, values)[own] for values in springs))
        spectra = np.zeros((len(self.names), self.grid.wavenumbers.size), dtype=np.complex128)
        (e, f), (e_across, f_across) = rows
        of_waves = self._where, self._waves.mode, self._waves.along
        superpose_tractions(transfers[0], transfers[1], e, f, e_across, f_across, *of_waves, spectra)
        return spectra

    def _means(self, springs: SpringFields, depth: float) -> Mapping[str, ComplexArray]:
        at, means = self._at_mean, dict[str, ComplexArray]()
        ways = [(i, way) for i, part in enumerate(self._parts) for way in range(part.ways)]
        names = ("z", "zz"), ("x", "xz"), ("y", "yz")
        for row, ((i, way), (axis, stress)) in enumerate(zip(ways, names, strict=False)):
            part, moved = self._parts[i], springs.strains[row, at]
            strains = self._of(i, springs.strains)
            for first, top, layer in zip(part.firsts, part.tops, self.body.present, strict=False):
                if depth > top:  # on a rigid base the layers are deformed one after the other
                    share = min((depth - top) / layer.thickness, 1.0)
                    moved = moved - share * strains[first + way, at]
            means |= {axis: moved, stress: -springs.forces[row, at]}
        return means


def _rows(surface: list[ComplexArray], springs: list[ComplexArray]) -> ComplexArray:
    """Return the values of the surface, (nq, n) each, and below them those of springs, (springs, nq)."""
    return np.vstack([*(part.T for part in surface), *springs])


@kernel(reorder=True)
def superpose_tractions(
    transfer: FloatArray,
    transfer_across: FloatArray,
    strains: ComplexArray,
    forces: ComplexArray,
    strains_across: ComplexArray,
    forces_across: ComplexArray,
    column: IntArray,
    mode: IntArray,
    n: FloatArray,
    spectra: ComplexArray,
) -> None:
    """Add the transforms of the fields, in the order of `LINE` or `SURFACE`, of waves to those of modes."""
    # `transfer` has the shape (waves, 6, springs), across (waves, 3, springs), `column` the numbers of the
    # waves there, (nq,), `n` their directions, (axes, nq).
    for i in range(column.size):
        T, at = transfer[column[i]], mode[i]
        W = U = szz = R = snn = stt = 0j
        for j in range(len(strains)):
            e, f = strains[j, i], forces[j, i]
            W, U = W + T[0, j] * e, U + T[1, j] * e
            szz, R, snn, stt = szz + T[2, j] * f, R + T[3, j] * f, snn + T[4, j] * f, stt + T[5, j] * f
        x = n[0, i]
        if len(n) == 1:
            spectra[0, at] += 1j * x * U
            spectra[1, at] += W
            spectra[2, at] += snn
            spectra[3, at] += stt
            spectra[4, at] += szz
            spectra[5, at] += 1j * x * R
        else:
            A = transfer_across[column[i]]
            V = Z = snt = 0j
            for j in range(len(strains_across)):
                e, f = strains_across[j, i], forces_across[j, i]
                V, Z, snt = V + A[0, j] * e, Z + A[1, j] * f, snt + A[2, j] * f
            y = n[1, i]
            spectra[0, at] += 1j * (x * U - y * V)
            spectra[1, at] += 1j * (y * U + x * V)
            spectra[2, at] += W
            spectra[3, at] += x * x * snn + y * y * stt - 2 * x * y * snt
            spectra[4, at] += y * y * snn + x * x * stt + 2 * x * y * snt
            spectra[5, at] += szz
            spectra[6, at] += x * y * (snn - stt) + (x * x - y * y) * snt
            spectra[7, at] += 1j * (x * R - y * Z)
            spectra[8, at] += 1j * (y * R + x * Z)
