"""A lattice of atoms joined by springs, pressed on a face: each grid point is a surface atom.

The springs have their natural length. The lattice answers by its surface layer: with the dynamical matrix
Phi of the surface, in which all layers below are eliminated, K = 1/(cell [Phi^-1]_zz), where cell is the
area of a surface atom. The bonds of an atom within its layer give D, those to the next layer U and V:

    D = sum_inside 4 sin^2(q.d/2) k nn^T      U = sum_down k nn^T      X = sum_down (1 - exp(i q.d)) k nn^T
    V = U - X                                 Y = sum_down 4 sin^2(q.d/2) k nn^T

Every second layer is eliminated, so that 2^n layers take n steps. The steps keep row sums in place of blocks,
T = D + X and R = D + Y: nothing of order one is subtracted, and long waves lose no digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from gfmdlayer.body.solid import OneModulus
from gfmdlayer.validation.fields import Count, Positive, Word, given
from gfmdlayer.validation.problems import Mistake

if TYPE_CHECKING:
    from gfmdlayer.arrays import ComplexArray, FloatArray
    from gfmdlayer.body.wavevectors import Wavevectors

_SAME = 1e-6  # relative difference of two lengths that are meant to be equal
_CHUNK = 1 << 14  # waves at a time

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

    def problems(self) -> Iterator[Mistake]:
        """Refuse a spring that the crystal does not have, and one that is missing."""
        if self.crystal == "fcc" and self.next_nearest is not None:
            message = "only for crystal: simple_cubic; remove it or set crystal: simple_cubic"
            yield Mistake(("next_nearest",), message, ("crystal",))
        if self.crystal == "simple_cubic" and self.next_nearest is None:
            message = "missing; crystal: simple_cubic needs a number > 0, for its shear stiffness"
            yield Mistake(("next_nearest",), message, ("crystal",))

    def problems_on_grid(self, points: Sequence[int], period: Sequence[float]) -> Iterator[Mistake]:
        """Refuse a grid whose points are not the surface atoms."""
        for number, length in zip(points, period, strict=False):
            if abs(length / (number * self.spacing) - 1) > _SAME:
                message = (
                    f"got {self.spacing!r}; must be {length / number:.10g}, the spacing of the grid, whose "
                    f"points are the surface atoms; or take period {number * self.spacing:.10g} for {number} "
                    "points"
                )
                yield Mistake(("spacing",), message)
                return

    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return 1/(cell [Phi^-1]_zz)."""
        import numpy as np

        q = self.spacing * np.stack((np.ravel(waves.qx), np.ravel(waves.qy)), axis=1)
        K = np.zeros(len(q))
        still = ~q.any(axis=1)
        some = np.flatnonzero(~still)
        for start in range(0, some.size, _CHUNK):
            part = some[start : start + _CHUNK]
            K[part] = 1 / np.linalg.inv(self._surface(q[part]))[:, 2, 2].real
        K /= self.spacing**2
        K[still] = self.mean_stiffness
        return np.asarray(K.reshape(waves.shape))

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
