"""The anisotropic halfspace of elastic constants C_ijkl: its stiffness depends on the direction of a wave.

For a wave along the unit vector e, with z into the body and (ab)_ik = a_j C_ijkl b_l (D. M. Barnett and
J. Lothe, Physica Norvegica 7 (1973) 13),

    K = q/[L^-1]_zz,   L = mean over omega in [0, pi) of Q - R T^-1 R^T,   Q = (nn), R = (nm), T = (mm),
    n = e cos(omega) + z sin(omega),   m = -e sin(omega) + z cos(omega)

Equal points in omega converge exponentially. K/q is a smooth function of the direction of period pi, and its
Fourier series is summed at the waves.

Under tractions in all directions the compliance is (L^-1 + i S L^-1)/q with S the mean of -T^-1 R^T (T. C.
T. Ting, Anisotropic Elasticity, 1996, sec. 6.6): the first part is symmetric, the second one antisymmetric.
Where neither couples displacements across the wave with the others, it is a `TractionSpectrum`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Literal

from gfmdlayer.body.materials import Material
from gfmdlayer.body.solid import OneModulus
from gfmdlayer.validation.fields import Finite, MustBe, Optional, given
from gfmdlayer.validation.problems import Mistake, shown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gfmdlayer.arrays import ComplexArray, FloatArray
    from gfmdlayer.body.relaxation import TractionSpectrum
    from gfmdlayer.body.wavevectors import Wavevectors

_SAME = 1e-6  # relative difference of two lengths that are meant to be equal
_ENOUGH = 1e-14  # relative change of a mean, or Fourier coefficient, that is left out
_MOST = 4096  # points in omega, or directions
_DIRECTIONS = 16  # at which the response to shear must be the same
_SOFTEST = 3e-3  # a strain this much softer than the stiffest constant: K then takes some 20 s

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

    def problems(self) -> Iterator[Mistake]:
        """Refuse missing constants, those of an unstable body, and axes that are not perpendicular."""
        lengths = [math.hypot(*axis) for axis in (self.normal, self.along)]
        if 0 in lengths:
            key = ("normal", "along")[lengths.index(0)]
            yield Mistake((key,), "got the direction 0; must have a length")
        elif abs(sum(a * b for a, b in zip(self.normal, self.along, strict=True))) > _SAME * math.prod(
            lengths
        ):
            message = f"got {shown(self.along)}; must be perpendicular to normal, {shown(self.normal)}"
            yield Mistake(("along",), message, ("normal",))
        names: tuple[str, ...] = ("C11", "C12", "C44", "C13", "C33", "C66")
        constants = {name: getattr(self, name) for name in names}
        if self.C is not None:
            for name in (name for name, value in constants.items() if value is not None):
                yield Mistake(
                    (name,), "given beside C, which has all constants; remove one of the two", ("C",)
                )
            size = max(abs(entry) for row in self.C for entry in row)
            if any(abs(self.C[i][j] - self.C[j][i]) > _SAME * size for i in range(6) for j in range(i)):
                yield Mistake(("C",), "is not symmetric; must be, row by row")
            elif not _positive(self.C):
                message = "is the energy of a body that is not stable; must be positive definite"
                yield Mistake(("C",), message)
            else:
                yield from self._nearly_unstable("C")
            return
        if None in [*constants.values()][:3]:
            missing = next(name for name in names if constants[name] is None)
            yield Mistake((missing,), "missing; must be a number, or give all constants in C", ("C",))
            return
        (C11, C12, C13), C33 = self.constants[0][:3], self.constants[2][2]
        names = ("C11", "C12", "C13", "C33")
        if abs(C12) >= C11:
            message = f"got {C12!r}; must be between -C11 and C11 = {C11!r}, else the body is not stable"
            yield Mistake(("C12",), message, names)
        elif 2 * C13**2 >= C33 * (C11 + C12):
            key = "C12" if self.C13 is None else "C13"
            most = math.sqrt(C33 * (C11 + C12) / 2)
            message = f"got {C13!r}; must be between -{most:.6g} and {most:.6g}, else the body is not stable"
            yield Mistake((key,), message, names)
        else:
            yield from self._nearly_unstable("C11")

    def _nearly_unstable(self, key: str) -> Iterator[Mistake]:
        """Refuse a body so near to instability that Barnett and Lothe's integral needs too many points."""
        least = _SOFTEST * max(abs(entry) for row in self.constants for entry in row)
        rows = enumerate(self.constants)
        if not _positive([[entry - least * (i == j) for j, entry in enumerate(row)] for i, row in rows]):
            limit = f"{least:.3g}, {_SOFTEST:g} of the largest constant"
            yield Mistake((key,), f"a strain has a stiffness below {limit}: the body is nearly unstable")

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return q/[L^-1]_zz."""
        import numpy as np

        coefficients = _series(self.constants, self.normal, self.along)
        angle = 2 * (np.arctan2(waves.qy, waves.qx) - math.radians(self.angle))
        over_q = np.full(waves.shape, coefficients[0])
        for m, (a, b) in enumerate(zip(coefficients[1::2], coefficients[2::2], strict=True), start=1):
            over_q += a * np.cos(m * angle) + b * np.sin(m * angle)
        return np.asarray(over_q * waves.magnitude)

    def traction_spectrum(self, waves: Wavevectors | ArrayLike) -> TractionSpectrum:
        """Return the relaxing modes under tractions in all directions, at wavevectors of any shape.

        Parameters
        ----------
        waves : Wavevectors or array
            Wavevectors, or magnitudes |q| on a line: 1/length.

        Returns
        -------
        TractionSpectrum
            A matrix over the directions for each mode: pressure / length.

        Raises
        ------
        ValueError
            If shear moves the surface across the waves too, or differently in their directions.
        """
        import numpy as np

        from gfmdlayer.body.relaxation import TractionSpectrum
        from gfmdlayer.body.wavevectors import Wavevectors

        assert isinstance(self.material, Material)  # as in every run
        waves = Wavevectors.of(waves)
        q = waves.magnitude
        angles = np.unique(np.round(np.arctan2(waves.qy, waves.qx)[q > 0] % np.pi, 9))
        some = angles[:: max(1, angles.size // _DIRECTIONS)] - math.radians(self.angle)
        every = _compliances(_turned(self.constants, self.normal, self.along), some)
        size = np.abs(every[:, 2, 2]).max()
        # Along the wave, across it, and out of the surface.
        own, others = every[:, [0, 2, 1]][:, :, [0, 2, 1]], [(0, 2), (1, 2), (2, 0), (2, 1)]
        odd = [np.abs(own[:, i, j]).max() for i, j in others] + [np.abs(own[:, 0, 1].real).max()]
        if max(odd) > _SAME * size or np.ptp(own.real, axis=0).max() > _SAME * size:
            raise ValueError(
                "shear moves the surface of the crystal across the waves too, or differently in their "
                "directions, which friction does not have; the normal must be a sixfold axis, or on a line "
                "along and normal axes of twofold symmetry"
            )
        C_UU, C_WW, C_VV = own[0].real.diagonal()
        C_WU = own[0, 1, 0].imag
        K = np.array([[C_UU, -C_WU], [-C_WU, C_WW]]) / (C_WW * C_UU - C_WU**2)
        unit = q / self.material.unit
        return TractionSpectrum.of_material(np.multiply.outer(unit, K), unit / C_VV, self.material)


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

    C = _turned(constants, normal, along)
    count = 8
    while True:
        count *= 2
        every = _compliances(C, np.pi * np.arange(count) / count)
        series = np.fft.rfft(1 / every[:, 2, 2].real) / count
        size = np.abs(series)
        if size[count // 4 :].max() <= _ENOUGH * size[0] or count >= _MOST:
            break
    felt = np.flatnonzero(size > _ENOUGH * size[0])
    kept = series[: min(int(felt.max()), count // 2 - 1) + 1]
    pairs = [(2 * float(coefficient.real), -2 * float(coefficient.imag)) for coefficient in kept[1:]]
    return (float(kept[0].real), *(number for pair in pairs for number in pair))


def _turned(
    constants: tuple[tuple[float, ...], ...], normal: tuple[float, ...], along: tuple[float, ...]
) -> FloatArray:
    """Return C_ijkl over the axes of the surface, z out of it."""
    import numpy as np

    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    C, z, x = np.array(constants), np.array(normal), np.array(along)
    C = ((C + C.T) / 2)[voigt[:, :, np.newaxis, np.newaxis], voigt]
    # z out of the surface: the crystal is its own mirror image through a point, and K(-q) = K(q).
    axes = np.stack((x / np.linalg.norm(x), np.cross(z, x), z / np.linalg.norm(z)))
    axes[1] /= np.linalg.norm(axes[1])
    return np.asarray(np.einsum("ai,bj,ck,dl,ijkl->abcd", axes, axes, axes, axes, C, optimize=True))


def _compliances(C: FloatArray, angles: FloatArray) -> ComplexArray:
    """Return q times the compliance of waves along directions in the surface, (directions, 3, 3).

    The components are along the wave, across it, and z; C is (3, 3, 3, 3).
    """
    import numpy as np

    zero, one = np.zeros(angles.size), np.ones(angles.size)
    cos, sin = np.cos(angles), np.sin(angles)
    e = np.stack((cos, sin, zero), axis=1)[:, np.newaxis]
    frame = np.stack((cos, sin, zero, -sin, cos, zero, zero, zero, one), axis=1).reshape(-1, 3, 3)
    z = np.array([0.0, 0.0, 1.0])
    count, last = 16, np.full((angles.size, 3, 3), np.inf, dtype=np.complex128)
    while True:
        omega = (np.pi * np.arange(count) / count)[:, np.newaxis]
        n, m = e * np.cos(omega) + z * np.sin(omega), -e * np.sin(omega) + z * np.cos(omega)
        Q, R, T = (
            np.einsum("pwj,ijkl,pwl->pwik", a, C, b, optimize=True) for a, b in ((n, n), (n, m), (m, m))
        )
        turned = np.linalg.solve(T, np.swapaxes(R, -1, -2))
        L, S = (Q - R @ turned).mean(axis=1), -turned.mean(axis=1)
        inverse = np.linalg.inv(L)
        found = frame @ (inverse + 1j * S @ inverse) @ np.swapaxes(frame, -1, -2)
        if np.abs(found - last).max() <= _ENOUGH * np.abs(found).max() or count >= _MOST:
            return np.asarray(found)
        count, last = 2 * count, found
