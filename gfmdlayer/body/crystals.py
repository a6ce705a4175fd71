"""Crystals and other anisotropic bodies: their stiffness depends on the direction of a wave.

The anisotropic halfspace of elastic constants C_ijkl (D. M. Barnett and J. Lothe, Physica Norvegica 7 (1973)
13): for a wave along the unit vector e, with z into the body and (ab)_ik = a_j C_ijkl b_l,

    K = q/[L^-1]_zz,   L = mean over omega in [0, pi) of Q - R T^-1 R^T,   Q = (nn), R = (nm), T = (mm),
    n = e cos(omega) + z sin(omega),   m = -e sin(omega) + z cos(omega)

Equal points in omega converge exponentially. K/q is a smooth function of the direction of period pi, and its
Fourier series is summed at the waves.

A lattice of atoms joined by springs at their natural length answers by its surface layer: with the dynamical
matrix Phi of the surface, in which all layers below are eliminated, K = 1/(cell [Phi^-1]_zz), where cell is
the area of a surface atom. The bonds of an atom within its layer give D, those to the next layer U and V:

    D = sum_inside 4 sin^2(q.d/2) k nn^T      U = sum_down k nn^T      X = sum_down (1 - exp(i q.d)) k nn^T
    V = U - X                                 Y = sum_down 4 sin^2(q.d/2) k nn^T

Every second layer is eliminated, so that 2^n layers take n steps. The steps keep row sums in place of blocks,
T = D + X and R = D + Y: nothing of order one is subtracted, and long waves lose no digits.

In each body all moduli relax alike: K(q, s) = K(q) G(s)/G(0).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import Field

from gfmdlayer.body.laws import LAWS
from gfmdlayer.body.materials import Elastic, Law
from gfmdlayer.body.solid import Solid
from gfmdlayer.validation.fields import (
    Count,
    File,
    Finite,
    Lengths,
    MustBe,
    NotNegative,
    Optional,
    Positive,
    Word,
    given,
)
from gfmdlayer.validation.problems import Problem, shown
from gfmdlayer.validation.sections import OneOf

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.arrays import ComplexArray, FloatArray
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.wavevectors import Wavevectors

_SAME = 1e-6  # relative difference of two lengths that are meant to be equal
_ENOUGH = 1e-14  # relative change of a mean, or Fourier coefficient, that is left out
_MOST = 4096  # points in omega, or directions
_SOFTEST = 3e-3  # a strain this much softer than the stiffest constant: K then takes some 20 s
_CHUNK = 1 << 14  # waves at a time


class OneModulus(Solid):
    """A body whose moduli all relax alike, by the law `material`; only the form of the law counts."""

    material: Annotated[Law, OneOf(LAWS)] = Field(default_factory=lambda: Elastic(1.0))
    """law by which all moduli relax alike, relative to its G0; default: elastic"""

    @abstractmethod
    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return K(q, 0), positive but at q = 0."""

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s)."""
        import numpy as np

        from gfmdlayer.body.wavevectors import Wavevectors

        found = self.relaxed_stiffness(Wavevectors.of(waves))
        return np.asarray(found * (self.material.laplace(s) / self.material.unit))

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return a mode for each branch of the law."""
        from gfmdlayer.body.materials import Material
        from gfmdlayer.body.relaxation import Spectrum
        from gfmdlayer.body.wavevectors import Wavevectors

        assert isinstance(self.material, Material)  # as in every run
        found = self.relaxed_stiffness(Wavevectors.of(waves))
        return Spectrum.of_material(found / self.material.unit, self.material)


Row = Annotated[
    tuple[Finite, Finite, Finite, Finite, Finite, Finite], MustBe("six numbers, a row of the matrix")
]
Matrix = Annotated[tuple[Row, Row, Row, Row, Row, Row], MustBe("six rows of six numbers")]
Direction = Annotated[tuple[Finite, Finite, Finite], MustBe("three numbers, a direction in the crystal")]


class Anisotropic(OneModulus):
    """A halfspace with elastic constants, in any orientation.

    The constants are C11, C12 and C44 of a cubic crystal, with C13, C33 and C66 of one with a fourfold or
    sixfold axis, or all 21 in the matrix C.

    Examples
    --------
    Silicon in GPa, pressed on (001): along [100] it is softer than along [110].

    >>> silicon = gfmdlayer.Anisotropic(C11=165.8, C12=63.9, C44=79.6)
    >>> silicon.stiffness(gfmdlayer.Wavevectors.of_components([1.0, 1.0], [0.0, 1.0]), 0.0).round(2)
    array([ 81.47, 118.06])

    Its (111) face has a threefold axis, and K(-q) = K(q):

    >>> face = gfmdlayer.Anisotropic(C11=165.8, C12=63.9, C44=79.6, normal=(1, 1, 1), along=(1, -1, 0))
    >>> phi = np.radians([0.0, 30.0, 60.0])
    >>> face.stiffness(gfmdlayer.Wavevectors.of_components(np.cos(phi), np.sin(phi)), 0.0).round(2)
    array([87.39, 87.97, 87.39])
    """

    kind: Literal["anisotropic"] = "anisotropic"
    """an elastic halfspace of given constants"""
    C11: Optional = None
    """elastic constant C11 = C22, axes along x and y: pressure"""
    C12: Annotated[Finite | None, given] = None
    """elastic constant C12: pressure"""
    C44: Optional = None
    """elastic constant C44 = C55: pressure"""
    C13: Annotated[Finite | None, given] = None
    """elastic constant C13 = C23; default C12: pressure"""
    C33: Optional = None
    """elastic constant C33, along z, into the body; default C11: pressure"""
    C66: Optional = None
    """elastic constant C66; default C44: pressure"""
    C: Annotated[Matrix | None, given] = None
    """all constants, in place of the others: 6 rows, in the order xx, yy, zz, yz, xz, xy: pressure"""
    normal: Direction = (0.0, 0.0, 1.0)
    """direction in the crystal that points out of the surface"""
    along: Direction = (1.0, 0.0, 0.0)
    """direction in the crystal along x of the grid, perpendicular to normal"""
    angle: Finite = 0.0
    """angle from the x axis of the grid to the direction along: degrees"""

    @property
    def unit(self) -> float:
        """C44."""
        return self.constants[3][3]

    @property
    def constants(self) -> tuple[tuple[float, ...], ...]:
        """The matrix C in Voigt's notation, 6 x 6, in the axes of the crystal."""
        if self.C is not None:
            return self.C
        assert self.C11 is not None and self.C12 is not None and self.C44 is not None  # noqa: PT018
        C13, C33, C66 = (
            own if own is not None else cubic
            for own, cubic in ((self.C13, self.C12), (self.C33, self.C11), (self.C66, self.C44))
        )
        normal = ((self.C11, self.C12, C13), (self.C12, self.C11, C13), (C13, C13, C33))
        shear = (self.C44, self.C44, C66)
        return (
            *((*row, 0.0, 0.0, 0.0) for row in normal),
            *((0.0,) * (3 + i) + (shear[i],) + (0.0,) * (2 - i) for i in range(3)),
        )

    def problems(self) -> Iterator[Problem]:
        """Refuse missing constants, those of an unstable body, and axes that are not perpendicular."""
        lengths = [math.hypot(*axis) for axis in (self.normal, self.along)]
        if 0 in lengths:
            key = ("normal", "along")[lengths.index(0)]
            yield Problem((key,), "got the direction 0; must have a length")
        elif abs(sum(a * b for a, b in zip(self.normal, self.along, strict=True))) > _SAME * math.prod(
            lengths
        ):
            message = f"got {shown(self.along)}; must be perpendicular to normal, {shown(self.normal)}"
            yield Problem(("along",), message, ("normal",))
        names: tuple[str, ...] = ("C11", "C12", "C44", "C13", "C33", "C66")
        found = {name: getattr(self, name) for name in names}
        if self.C is not None:
            for name in (name for name, value in found.items() if value is not None):
                yield Problem(
                    (name,), "given beside C, which has all constants; remove one of the two", ("C",)
                )
            size = max(abs(each) for row in self.C for each in row)
            if any(abs(self.C[i][j] - self.C[j][i]) > _SAME * size for i in range(6) for j in range(i)):
                yield Problem(("C",), "is not symmetric; must be, row by row")
            elif not _positive(self.C):
                message = "is the energy of a body that is not stable; must be positive definite"
                yield Problem(("C",), message)
            else:
                yield from self._nearly_unstable("C")
            return
        if None in [*found.values()][:3]:
            missing = next(name for name in names if found[name] is None)
            yield Problem((missing,), "missing; must be a number, or give all constants in C", ("C",))
            return
        (C11, C12, C13), C33 = self.constants[0][:3], self.constants[2][2]
        names = ("C11", "C12", "C13", "C33")
        if abs(C12) >= C11:
            message = f"got {C12!r}; must be between -C11 and C11 = {C11!r}, else the body is not stable"
            yield Problem(("C12",), message, names)
        elif 2 * C13**2 >= C33 * (C11 + C12):
            key = "C12" if self.C13 is None else "C13"
            most = math.sqrt(C33 * (C11 + C12) / 2)
            message = f"got {C13!r}; must be between -{most:.6g} and {most:.6g}, else the body is not stable"
            yield Problem((key,), message, names)
        else:
            yield from self._nearly_unstable("C11")

    def _nearly_unstable(self, key: str) -> Iterator[Problem]:
        """Refuse a body so near to instability that Barnett and Lothe's integral needs too many points."""
        least = _SOFTEST * max(abs(each) for row in self.constants for each in row)
        rows = enumerate(self.constants)
        if not _positive([[each - least * (i == j) for j, each in enumerate(row)] for i, row in rows]):
            limit = f"{least:.3g}, {_SOFTEST:g} of the largest constant"
            yield Problem((key,), f"a strain has a stiffness below {limit}: the body is nearly unstable")

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return q/[L^-1]_zz."""
        import numpy as np

        coefficients = _series(self.constants, self.normal, self.along)
        angle = 2 * (np.arctan2(waves.qy, waves.qx) - math.radians(self.angle))
        found = np.full(waves.shape, coefficients[0])
        for m, (a, b) in enumerate(zip(coefficients[1::2], coefficients[2::2], strict=True), start=1):
            found += a * np.cos(m * angle) + b * np.sin(m * angle)
        return np.asarray(found * waves.magnitude)


def _positive(matrix: Sequence[Sequence[float]]) -> bool:
    """Whether a symmetric matrix is positive definite, by its pivots."""
    rows = [list(row) for row in matrix]
    for k, pivot in enumerate(rows):
        if not pivot[k] > 0:
            return False
        for row in rows[k + 1 :]:
            part = row[k] / pivot[k]
            row[k:] = [a - part * b for a, b in zip(row[k:], pivot[k:], strict=True)]
    return True


@lru_cache(maxsize=16)
def _series(
    constants: tuple[tuple[float, ...], ...], normal: tuple[float, ...], along: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the Fourier series of K/q over twice the angle: mean, and cosine and sine of each order."""
    import numpy as np

    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    C, z, x = np.array(constants), np.array(normal), np.array(along)
    C = ((C + C.T) / 2)[voigt[:, :, np.newaxis, np.newaxis], voigt]
    # z out of the surface: the crystal is its own mirror image through a point, and K(-q) = K(q).
    axes = np.stack((x / np.linalg.norm(x), np.cross(z, x), z / np.linalg.norm(z)))
    axes[1] /= np.linalg.norm(axes[1])
    C = np.einsum("ai,bj,ck,dl,ijkl->abcd", axes, axes, axes, axes, C, optimize=True)
    count = 8
    while True:
        count *= 2
        found = np.fft.rfft(_at_directions(C, np.pi * np.arange(count) / count)) / count
        size = np.abs(found)
        if size[count // 4 :].max() <= _ENOUGH * size[0] or count >= _MOST:
            break
    felt = np.flatnonzero(size > _ENOUGH * size[0])
    kept = found[: min(int(felt.max()), count // 2 - 1) + 1]
    pairs = [(2 * float(each.real), -2 * float(each.imag)) for each in kept[1:]]
    return (float(kept[0].real), *(number for pair in pairs for number in pair))


def _at_directions(C: FloatArray, angles: FloatArray) -> FloatArray:
    """Return K/q of waves along directions in the surface; C is (3, 3, 3, 3)."""
    import numpy as np

    zero = np.zeros(angles.size)
    e = np.stack((np.cos(angles), np.sin(angles), zero), axis=1)[:, np.newaxis]
    z = np.array([0.0, 0.0, 1.0])
    count, last = 16, np.full(angles.size, np.inf)
    while True:
        omega = (np.pi * np.arange(count) / count)[:, np.newaxis]
        n, m = e * np.cos(omega) + z * np.sin(omega), -e * np.sin(omega) + z * np.cos(omega)
        Q, R, T = (
            np.einsum("pwj,ijkl,pwl->pwik", a, C, b, optimize=True) for a, b in ((n, n), (n, m), (m, m))
        )
        L = (Q - R @ np.linalg.solve(T, np.swapaxes(R, -1, -2))).mean(axis=1)
        found = 1 / np.linalg.inv(L)[:, 2, 2]
        if np.abs(found - last).max() <= _ENOUGH * found.max() or count >= _MOST:
            return np.asarray(found)
        count, last = 2 * count, found


# A bond: its step along the surface and its direction, in units of the spacing of surface atoms, and which of
# the springs it has, nearest or next-nearest neighbours.
Bond = tuple[tuple[float, float], tuple[float, float, float], int]
_R, _H = math.sqrt(0.5), 0.5
_DIAGONALS = ((_H, _H), (_H, -_H), (-_H, _H), (-_H, -_H))
_AXES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
_ALONG: tuple[Bond, ...] = (((1.0, 0.0), (1.0, 0.0, 0.0), 0), ((0.0, 1.0), (0.0, 1.0, 0.0), 0))


class _Face(NamedTuple):
    """The bonds of an atom of a surface."""

    inside: Sequence[Bond]  # within its layer, one of each pair
    down: Sequence[Bond]  # to the layer below
    height: float  # of a layer, in units of the spacing
    edge: float  # of the cubic cell, likewise


FACES = {
    "simple_cubic": _Face(
        [*_ALONG, ((1.0, 1.0), (_R, _R, 0.0), 1), ((1.0, -1.0), (_R, -_R, 0.0), 1)],
        [((0.0, 0.0), (0.0, 0.0, 1.0), 0), *(((x, y), (_R * x, _R * y, _R), 1) for x, y in _AXES)],
        1.0,
        1.0,
    ),
    "fcc": _Face(_ALONG, [((x, y), (x, y, _R), 0) for x, y in _DIAGONALS], _R, math.sqrt(2)),
}


class Lattice(OneModulus):
    """A crystal of atoms joined by springs, pressed on its (100) face; each grid point is a surface atom.

    `simple_cubic` has springs to nearest and next-nearest neighbours, x along [100]; `fcc` to the nearest, x
    along [110].

    Examples
    --------
    At the edge of the zone the crystal is softer than its continuum, whose K is 4.19 there:

    >>> crystal = gfmdlayer.Lattice(crystal="simple_cubic", nearest=1.0, next_nearest=1.0, spacing=1.0)
    >>> crystal.stiffness([np.pi], 0.0).round(6)
    array([2.828427])
    """

    kind: Literal["lattice"] = "lattice"
    """atoms joined by springs"""
    crystal: Annotated[str, Word(*FACES)] = "fcc"
    """simple_cubic, or fcc (default); its (100) face"""
    nearest: Positive
    """spring between nearest neighbours: pressure length"""
    next_nearest: Annotated[Positive | None, given] = None
    """simple_cubic: spring between next-nearest neighbours: pressure length"""
    spacing: Positive
    """distance of surface atoms, period over points: length"""
    layers: Annotated[Count | None, given] = None
    """number of moving layers on a rigid one; default: without end"""

    @property
    def unit(self) -> float:
        """C44 of the continuum."""
        return self.constants[2]

    @property
    def constants(self) -> tuple[float, float, float]:
        """Elastic constants C11, C12 and C44 of the continuum."""
        edge, k1, k2 = FACES[self.crystal].edge * self.spacing, self.nearest, self.next_nearest
        if self.crystal == "fcc":
            return 2 * k1 / edge, k1 / edge, k1 / edge
        assert k2 is not None
        return (k1 + 2 * k2) / edge, k2 / edge, k2 / edge

    @property
    def mean_stiffness(self) -> float:
        """C11 over the thickness of the layers; 0 where these are without end."""
        if self.layers is None:
            return 0.0
        return self.constants[0] / (self.layers * FACES[self.crystal].height * self.spacing)

    def problems(self) -> Iterator[Problem]:
        """Refuse a spring that the crystal does not have, and one that is missing."""
        if self.crystal == "fcc" and self.next_nearest is not None:
            message = "only for crystal: simple_cubic; remove it or set crystal: simple_cubic"
            yield Problem(("next_nearest",), message, ("crystal",))
        if self.crystal == "simple_cubic" and self.next_nearest is None:
            message = "missing; crystal: simple_cubic needs a number > 0, for its shear stiffness"
            yield Problem(("next_nearest",), message, ("crystal",))

    def problems_on_grid(self, points: Sequence[int], period: Sequence[float]) -> Iterator[Problem]:
        """Refuse a grid whose points are not the surface atoms."""
        for number, length in zip(points, period, strict=False):
            if abs(length / (number * self.spacing) - 1) > _SAME:
                message = (
                    f"got {self.spacing!r} on a grid of spacing {length / number:.10g}; each point "
                    f"is a surface atom: period {number * self.spacing:.10g} for {number} points"
                )
                yield Problem(("spacing",), message)
                return

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return 1/(cell [Phi^-1]_zz)."""
        import numpy as np

        q = self.spacing * np.stack((np.ravel(waves.qx), np.ravel(waves.qy)), axis=1)
        found = np.zeros(len(q))
        still = ~q.any(axis=1)
        some = np.flatnonzero(~still)
        for start in range(0, some.size, _CHUNK):
            part = some[start : start + _CHUNK]
            found[part] = 1 / np.linalg.inv(self._surface(q[part]))[:, 2, 2].real
        found /= self.spacing**2
        found[still] = self.mean_stiffness
        return np.asarray(found.reshape(waves.shape))

    def _surface(self, q: FloatArray) -> ComplexArray:
        """Return Phi at wavevectors times the spacing, (nq, 2): the lower layers are eliminated."""
        import numpy as np

        D, U, X, Y = self._blocks(q)
        if self.layers is not None:
            Z = D + U
            for _ in range(self.layers - 1):
                W = np.linalg.inv(Z + U)
                back = _adjoint(X)
                Z = _hermitian(D + U @ W @ Z + X @ W @ U + U @ W @ back - X @ W @ back)
            return np.asarray(Z)
        V, R, T = U - X, D + Y, D + X
        while True:
            E = np.linalg.inv(R + V + _adjoint(V))
            added = V @ E @ R
            T, R, V = T + added, _hermitian(2 * R - R @ E @ R), V @ E @ V
            if np.abs(added).max() <= 1e-17 * np.abs(T).max():
                return np.asarray(_hermitian(T))

    def _blocks(self, q: FloatArray) -> tuple[ComplexArray, ...]:
        """Return D, U, X and Y."""
        import numpy as np

        face, springs = FACES[self.crystal], (self.nearest, self.next_nearest or 0.0)
        D, U, X, Y = (np.zeros((len(q), 3, 3), dtype=np.complex128) for _ in range(4))
        for bonds, is_down in ((face.inside, False), (face.down, True)):
            for step, direction, which in bonds:
                half = (q @ np.array(step))[:, np.newaxis, np.newaxis] / 2
                pull = springs[which] * np.multiply.outer(direction, direction)
                if is_down:
                    U += pull
                    X += (2 * np.sin(half) ** 2 - 1j * np.sin(2 * half)) * pull
                    Y += 4 * np.sin(half) ** 2 * pull
                else:
                    D += 4 * np.sin(half) ** 2 * pull
        return D, U, X, Y


def _adjoint(matrices: ComplexArray) -> Any:
    return matrices.swapaxes(-1, -2).conj()


def _hermitian(matrices: Any) -> Any:
    return 0.5 * (matrices + _adjoint(matrices))


class Tabulated(OneModulus):
    """A body whose relaxed stiffness is a table in a file, over |q| or over (qx, qy).

    Of a text file the columns are q and K, the same in all directions; between the rows K is a monotone cubic
    in the logarithms, and waves beyond them are refused. Other files have K at the waves of the grid, in the
    order of NumPy's FFT, such as another code computes them for its crystal: a .npy file; the dataset
    `stiffness` of an HDF5 file (.h5), whose attribute `period` may have the period; or the file
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

    @property
    def mean_stiffness(self) -> float:
        """The stiffness at q = 0."""
        return self.mean

    @property
    def _format(self) -> str:
        """The end of the name that tells how the file is read; "" for columns."""
        name = self.table.name
        return ".bin" if ".bin" in self.table.suffixes else name[name.rfind(".") :] * name.endswith(_ARRAYS)

    def problems(self) -> Iterator[Problem]:
        """Refuse a period beside a file that has its own, and an array without one."""
        if self._format == ".npy" and self.period is None:
            yield Problem(("period",), "missing; a .npy file needs the period of its grid", ("table",))
        if self._format not in _ARRAYS and self.period is not None:
            message = "only for a .npy or .h5 file; others have their wavenumbers; remove it"
            yield Problem(("period",), message, ("table",))

    def problems_on_grid(self, points: Sequence[int], period: Sequence[float]) -> Iterator[Problem]:
        """Refuse an array of other waves than those of the grid."""
        if not self._format or (self._format == ".npy" and self.period is None):
            return
        try:
            held, own = self._array
        except ValueError as error:
            yield Problem(("table",), str(error))
            return
        if held.shape != tuple(points):
            message = f"holds an array of shape {held.shape}; must be that of grid.points, {tuple(points)}"
            yield Problem(("table",), f"{self.table}: {message}")
        elif any(abs(one / other - 1) > _SAME for one, other in zip(own, period, strict=False)):
            message = f"{shown(tuple(period))}, of {' x '.join(map(str, points))} surface atoms"
            if self.period is not None:
                yield Problem(("period",), f"got {shown(self.period)}; must be grid.period, {message}")
            else:
                yield Problem(("table",), f"{self.table}: has the period {shown(own)}; must be {message}")

    @property
    def _array(self) -> tuple[FloatArray, tuple[float, ...]]:
        """The array of the file and its period; a ValueError where it cannot be used."""
        held, period = _array(self.table, self._format, self.table.stat().st_mtime_ns)
        own: Any = period if self.period is None else self.period
        if own is None:
            raise ValueError(f"{self.table}: stiffness has no attribute period; give the key period")
        own = own if isinstance(own, tuple) else (own,) * held.ndim
        return held, own

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return K(q); a ValueError for waves beyond the rows, or a file that cannot be used."""
        import numpy as np
        from scipy.interpolate import PchipInterpolator

        from gfmdlayer.files.tables import TableError

        q = waves.magnitude
        moving = q[q > 0]
        found = np.full(q.shape, float(self.mean))
        if self._format:
            held, period = self._array
            each = zip((waves.qx, waves.qy), period, held.shape, strict=False)
            places = tuple(np.rint(x * L / (2 * np.pi)).astype(int) % n for x, L, n in each)
            found[q > 0] = held[places][q > 0]
            return np.asarray(found)
        try:
            rows = _rows(self.table, self.table.stat().st_mtime_ns)
        except TableError as error:
            raise ValueError(str(error)) from None
        least, most = rows[0][0], rows[0][-1]
        if moving.size and (moving.min() < least * (1 - _SAME) or moving.max() > most * (1 + _SAME)):
            raise ValueError(
                f"{self.table}: has q from {least:.6g} to {most:.6g}; must hold those of the grid, "
                f"{moving.min():.6g} to {moving.max():.6g}"
            )
        logs = np.log(np.clip(moving, least, most))
        found[q > 0] = np.exp(PchipInterpolator(*np.log(rows))(logs))
        return np.asarray(found)


_ARRAYS = (".npy", ".h5", ".hdf5")


@lru_cache(maxsize=2)
def _array(file: Path, kind: str, _changed: int) -> tuple[FloatArray, tuple[float, ...] | None]:
    """Return K over the waves of a grid, and its period where the file has it; a ValueError for others."""
    import numpy as np

    period: tuple[float, ...] | None = None
    try:
        if kind == ".bin":
            found, period = _of_fix_gfc(file)
        elif kind == ".npy":
            found = np.asarray(np.load(file, allow_pickle=False))
        else:
            import h5py

            with h5py.File(file) as h5:
                dataset = h5["stiffness"]
                found = np.asarray(dataset[()])
                if "period" in dataset.attrs:
                    each = np.broadcast_to(dataset.attrs["period"], found.ndim)
                    period = tuple(each.astype(float).tolist())
        found = found.astype(np.float64, casting="same_kind", copy=False)  # complex numbers are refused
    except (OSError, ValueError, EOFError, KeyError, TypeError) as error:
        reason = str(error).strip('"')
        raise ValueError(f"{file}: cannot be read as an array ({reason}); see gfmdlayer.Tabulated") from None
    moving = np.ravel(found)[1:]
    if found.ndim not in (1, 2) or not np.isfinite(moving).all() or (moving <= 0).any():
        raise ValueError(f"{file}: must hold finite numbers along one axis or two, > 0 but at q = 0")
    back = found[np.ix_(*(-np.arange(n) for n in found.shape))]
    if (np.abs(found - back) > _SAME * np.abs(found)).any():
        raise ValueError(f"{file}: differs between q and -q; must be equal, in the order of NumPy's FFT")
    return found, period


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
    found = np.zeros(Phi.shape[:-2])
    some = np.ones(found.shape, dtype=bool)
    some.flat[0] = False  # the mean displacement costs no energy
    found[some] = 1 / (cell * np.linalg.inv(Phi[some])[:, -1, -1].real)
    return found, tuple(map(float, lengths))


_HEAD = 24  # bytes: four integers and a number


@lru_cache(maxsize=8)
def _rows(file: Path, _changed: int) -> FloatArray:
    """Return the two columns of a table of stiffness."""
    from gfmdlayer.files.tables import read_columns

    def refused(row: Sequence[float]) -> str:
        return "" if min(row) > 0 else f"holds {min(row):g}; wavenumber and stiffness must be > 0"

    return read_columns(file, ("q", "K"), increasing=True, row_error=refused).T
