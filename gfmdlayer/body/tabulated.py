"""A body whose relaxed stiffness is a table in a file: measured, or computed by another code."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import PrivateAttr

from gfmdlayer.body.solid import OneModulus
from gfmdlayer.validation.fields import File, Lengths, NotNegative, given
from gfmdlayer.validation.problems import Mistake, shown
from gfmdlayer.validation.reading import Reading, answers
from gfmdlayer.validation.units import Units, label_of

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.wavevectors import Wavevectors

_SAME = 1e-6  # relative difference of two lengths, or stiffnesses, that are meant to be equal


class Tabulated(OneModulus):
    """A body whose relaxed stiffness is a table in a file, over |q| or over (qx, qy).

    Of a text file the columns are q and K, the same in all directions; between the rows, in any order, K is a
    monotone cubic in the logarithms, and waves beyond them are refused. Other files have K at the waves of
    the grid, in the order of NumPy's FFT, such as another code computes them for its crystal: a .npy file;
    the dataset `stiffness` of an HDF5 file (.h5), whose attribute `period` may have the period; or the file
    PREFIX.bin.STEP with the elastic stiffness coefficients Phi(q) that `fix gfc` of LAMMPS measures
    (L. T. Kong et al., Comput. Phys. Commun. 180 (2009) 1004), of which K = 1/(cell [Phi^-1]_zz), in the
    units of that simulation. Its cells are rectangular, with one atom each.

    Examples
    --------
    >>> q = np.geomspace(1.0, 1e3, 20)
    >>> np.savetxt("measured.txt", np.column_stack((q, 2 * q)))
    >>> gfmdlayer.Tabulated(table="measured.txt").stiffness([0.0, 10.0], 0.0).round(6)
    array([ 0., 20.])
    """

    kind: Literal["table"] = "table"
    """relaxed stiffness from a table"""
    table: File
    """text with columns q and K; or K at the waves of the grid: .npy, .h5, or .bin.STEP of LAMMPS"""
    period: Annotated[Lengths | None, given] = None
    """.npy, .h5: period of the grid of its waves, or [Lx, Ly]: length"""
    mean: NotNegative = 0.0
    """stiffness at q = 0; default 0: the mean displacement is prescribed: pressure/length"""
    reading: Annotated[Reading | None, given] = None
    """how the text is read, where it does not say so"""

    _units: Units | None = PrivateAttr(default=None)  # of the configuration

    def in_units(self, units: Units | None) -> Tabulated:
        """Return the body whose columns are converted into units."""
        body = self.model_copy()
        body._units = units
        return body

    def account(self) -> str:
        """Say in one line how the columns of a text were read."""
        return "" if self._format else self._rows.account

    @property
    def mean_stiffness(self) -> float:
        """The stiffness at q = 0."""
        return self.mean

    @property
    def _format(self) -> str:
        """The end of the name that tells how the file is read; "" for columns."""
        name = self.table.name
        return ".bin" if ".bin" in self.table.suffixes else name[name.rfind(".") :] * name.endswith(_ARRAYS)

    def problems(self) -> Iterator[Mistake]:
        """Refuse a period beside a file that has its own, and an array without one."""
        if self._format == ".npy" and self.period is None:
            yield Mistake(("period",), "missing; a .npy file needs the period of its grid", ("table",))
        if self._format not in _ARRAYS and self.period is not None:
            message = "only for a .npy or .h5 file; others have their wavenumbers; remove it"
            yield Mistake(("period",), message, ("table",))
        if self._format and self.reading is not None:
            yield Mistake(("reading",), "only for a text with columns; remove it", ("table",))

    def problems_on_grid(self, points: Sequence[int], period: Sequence[float]) -> Iterator[Mistake]:
        """Refuse an array of other waves than those of the grid."""
        if not self._format or (self._format == ".npy" and self.period is None):
            return
        try:
            held, own = self._array
        except ValueError as error:
            yield Mistake(("table",), str(error))
            return
        if held.shape != tuple(points):
            message = f"holds an array of shape {held.shape}; must be that of grid.points, {tuple(points)}"
            yield Mistake(("table",), f"{self.table}: {message}")
        elif any(abs(one / other - 1) > _SAME for one, other in zip(own, period, strict=False)):
            message = f"{shown(tuple(period))}, of {' x '.join(map(str, points))} surface atoms"
            if self.period is not None:
                yield Mistake(("period",), f"got {shown(self.period)}; must be grid.period, {message}")
            else:
                yield Mistake(("table",), f"{self.table}: has the period {shown(own)}; must be {message}")

    @property
    def _array(self) -> tuple[FloatArray, tuple[float, ...]]:
        """The array of the file and its period; a ValueError where it cannot be used."""
        held, period = _array(self.table, self._format, self.table.stat().st_mtime_ns)
        own: Any = period if self.period is None else self.period
        if own is None:
            raise ValueError(f"{self.table}: stiffness has no attribute period; give the key period")
        own = own if isinstance(own, tuple) else (own,) * held.ndim
        return held, own

    @property
    def _rows(self) -> _TabulatedStiffness:
        return _rows(self.table, self._units, self.reading, self.table.stat().st_mtime_ns)

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return K(q); a ValueError for waves beyond the rows, or a file that cannot be used."""
        import numpy as np
        from scipy.interpolate import PchipInterpolator

        from gfmdlayer.files.tables import TableError

        q = waves.magnitude
        moving = q[q > 0]
        K = np.full(q.shape, float(self.mean))
        if self._format:
            held, period = self._array
            axes = zip((waves.qx, waves.qy), period, held.shape, strict=False)
            places = tuple(np.rint(x * L / (2 * np.pi)).astype(int) % n for x, L, n in axes)
            K[q > 0] = held[places][q > 0]
            return np.asarray(K)
        try:
            rows = self._rows.values
        except TableError as error:
            raise ValueError(str(error)) from None
        least, most = rows[0][0], rows[0][-1]
        if moving.size and (moving.min() < least * (1 - _SAME) or moving.max() > most * (1 + _SAME)):
            raise ValueError(
                f"{self.table}: has q from {least:.6g} to {most:.6g}; must hold those of the grid, "
                f"{moving.min():.6g} to {moving.max():.6g}"
            )
        logs = np.log(np.clip(moving, least, most))
        K[q > 0] = np.exp(PchipInterpolator(*np.log(rows))(logs))
        return np.asarray(K)


_ARRAYS = (".npy", ".h5", ".hdf5")


@lru_cache(maxsize=2)
def _array(file: Path, kind: str, _changed: int) -> tuple[FloatArray, tuple[float, ...] | None]:
    """Return K over the waves of a grid, and its period where the file has it; a ValueError for others."""
    import numpy as np

    period: tuple[float, ...] | None = None
    try:
        if kind == ".bin":
            K, period = _of_fix_gfc(file)
        elif kind == ".npy":
            K = np.asarray(np.load(file, allow_pickle=False))
        else:
            from gfmdlayer.files.hdf5 import open_hdf5, refuse_other_files

            with open_hdf5(file) as h5:
                refuse_other_files(file, h5)
                dataset = h5["stiffness"]
                K = np.asarray(dataset[()])
                if "period" in dataset.attrs:
                    lengths = np.broadcast_to(dataset.attrs["period"], K.ndim)
                    period = tuple(lengths.astype(float).tolist())
        K = K.astype(np.float64, casting="same_kind", copy=False)  # complex numbers are refused
    except (OSError, ValueError, EOFError, KeyError, TypeError) as error:
        reason = str(error).strip('"')
        raise ValueError(f"{file}: cannot be read as an array ({reason}); see gfmdlayer.Tabulated") from None
    moving = np.ravel(K)[1:]
    if K.ndim not in (1, 2) or not np.isfinite(moving).all() or (moving <= 0).any():
        raise ValueError(f"{file}: must hold finite numbers along one axis or two, > 0 but at q = 0")
    back = K[np.ix_(*(-np.arange(n) for n in K.shape))]
    if (np.abs(K - back) > _SAME * np.abs(K)).any():
        raise ValueError(f"{file}: differs between q and -q; must be equal, in the order of NumPy's FFT")
    return K, period


def _of_fix_gfc(file: Path) -> tuple[FloatArray, tuple[float, ...]]:
    """Return K and the period of coefficients Phi(q) that LAMMPS's `fix gfc` has measured."""
    # The file has the integers d, nx, ny and atoms a cell, Boltzmann's constant, nx ny complex matrices Phi
    # of energy/length^2, whose last direction is normal to the surface, the two vectors of a cell, and the
    # places of its atoms.
    import numpy as np

    data = file.read_bytes()
    if len(data) < _HEAD:
        raise ValueError("it ends within its head")
    axes, *shape, atoms = (int(n) for n in np.frombuffer(data, "<i4", 4))
    size = axes * atoms
    if axes not in (2, 3) or min(*shape, atoms) < 1 or (axes == 2 and shape[1] != 1):
        raise ValueError(f"its head has {axes} dimensions, {shape[0]} x {shape[1]} cells of {atoms} atoms")
    expected = _HEAD + 16 * math.prod(shape) * size**2 + 8 * (4 + size)
    if len(data) != expected:
        raise ValueError(f"it has {len(data)} bytes; must be {expected}")
    if atoms > 1:
        raise ValueError(f"its cells have {atoms} atoms; must have one, a surface atom at each point")
    Phi = np.frombuffer(data, "<c16", math.prod(shape) * size**2, _HEAD).reshape(*shape, size, size)
    vectors = np.frombuffer(data, "<f8", 4, _HEAD + Phi.nbytes).reshape(2, 2)
    if axes == 2:
        Phi, cell, lengths = Phi[:, 0], vectors[0, 0], (vectors[0, 0] * shape[0],)
    else:
        if np.abs(vectors[[0, 1], [1, 0]]).max() > _SAME * np.abs(vectors).max():
            raise ValueError("its cells are skew; must be rectangles along x and y")
        cell, lengths = vectors[0, 0] * vectors[1, 1], tuple(np.diag(vectors) * shape)
    K = np.zeros(Phi.shape[:-2])
    some = np.ones(K.shape, dtype=bool)
    some.flat[0] = False  # the mean displacement costs no energy
    K[some] = 1 / (cell * np.linalg.inv(Phi[some])[:, -1, -1].real)
    return K, tuple(map(float, lengths))


_HEAD = 24  # bytes: four integers and a number


class _TabulatedStiffness(NamedTuple):
    """Wavenumbers and stiffness, shape (2, rows), and how their file was read."""

    values: FloatArray
    account: str


@lru_cache(maxsize=8)
def _rows(file: Path, units: Units | None, reading: Reading | None, _changed: int) -> _TabulatedStiffness:
    """Return the two columns of a table of stiffness, in the order of wavenumbers."""
    import numpy as np

    from gfmdlayer.files.tables import TableError, read_table

    table = read_table(file, ("wavenumber", "stiffness"), answers(reading))
    q = table.take("wavenumber", label_of(units, "1 / length"))
    K = table.take("stiffness", label_of(units, "pressure / length"))
    smaller = np.minimum(q, K)
    if smaller[row := int(smaller.argmin())] <= 0:
        found = f"holds {smaller[row]:g}; wavenumber and stiffness must be > 0"
        raise TableError(f"{table.place(row)}: {found}")
    order = table.ascending(q, "wavenumber")
    return _TabulatedStiffness(np.stack((q, K))[:, order], table.account)
