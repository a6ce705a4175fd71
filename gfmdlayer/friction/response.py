"""The response of a surface to tractions in all directions, and its action on fields.

Per wavevector q with unit vector n: displacement W into the body, along the wave u_n = i U, across it V; on
the surface the pressure p, the traction i T along n and S across it (both on the body). Then

    W = C_WW p + C_WU T,    U = C_WU p + C_UU T,    V = C_VV S

with real C. In components C is Hermitian, and real but for the coupling of p with t, -i C_WU n. Parts that
are odd along an axis vanish at its largest wavenumber, where +q and -q share a mode.

Fields stand one below the other, (p, t_x[, t_y]) and (W, u_x[, u_y]), of shape (1 + axes, points).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import kernel


@dataclass(frozen=True)
class Response:
    """Compliance of a surface at the modes of a grid, displacement over traction: C_WW, C_WU, C_UU, C_VV.

    The value at q = 0 is that of the mean: zero where the mean displacement is fixed. There `along` is the
    tangential compliance in all directions.
    """

    normal: FloatArray  # C_WW
    coupling: FloatArray  # C_WU
    along: FloatArray  # C_UU
    across: FloatArray  # C_VV; without a meaning on a line

    @classmethod
    def of_halfspace(cls, grid: Grid, modulus: float, poisson: float) -> Response:
        """Response of an elastic halfspace of fixed mean displacement."""
        q = grid.wavenumbers
        with np.errstate(divide="ignore"):
            unit = np.where(q > 0, 1 / (modulus * q), 0.0)
        return cls((1 - poisson) * unit, 0.5 * (1 - 2 * poisson) * unit, (1 - poisson) * unit, unit)

    @classmethod
    def of_stiffness(cls, in_plane: FloatArray, across: FloatArray) -> Response:
        """Response of a stiffness K over (W, U), shape (*modes, 2, 2), and of that over V.

        Where K is zero, at q = 0, the mean displacement is fixed; the mean of W and that of u do not couple.
        """
        normal, coupling, along = in_plane[..., 0, 0], in_plane[..., 0, 1], in_plane[..., 1, 1]
        mean = np.zeros(normal.shape, dtype=bool)
        mean.flat[0] = True
        coupling = np.where(mean, 0.0, coupling)
        with np.errstate(divide="ignore", invalid="ignore"):
            whole = normal * along - coupling**2
            found = along / whole, -coupling / whole, normal / whole, 1 / across
            alone = 1 / normal, np.zeros(normal.shape), 1 / along, 1 / across
        return cls(*(_finite(np.where(mean, one, other)) for one, other in zip(alone, found, strict=True)))

    @property
    def couples(self) -> bool:
        """Whether shear moves the surface up and down."""
        return bool(self.coupling.any())

    def on(self, fine: Transforms, coarse: Transforms) -> Response:
        """Response at the modes of a coarser grid of the same cell."""
        parts = self.normal, self.coupling, self.along, self.across
        return Response(*(fine.truncated(part, coarse).reshape(coarse.spectral_shape) for part in parts))

    def inverse(self, grid: Grid) -> Response:
        """Stiffness without the coupling; a fixed mean has that of the longest wave."""
        found = []
        for part in (self.normal, self.along, self.across):
            positive = part.ravel().copy()
            if positive[0] <= 0:
                longest = np.argmin(np.where(grid.wavenumbers.ravel() > 0, grid.wavenumbers.ravel(), np.inf))
                positive[0] = positive[longest]
            found.append((1 / positive).reshape(part.shape))
        if len(grid.points) > 1:  # the mean has no direction
            found[1].flat[0] = 2 / (1 / found[1].flat[0] + 1 / found[2].flat[0])
        return Response(found[0], np.zeros_like(found[0]), found[1], found[2])


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)


@dataclass
class Spent:
    """FFT pairs of one real field on the finest grid; those in single precision count half."""

    pairs: float = 0.0


class Operator:
    """A response at the points of a grid, in double and in single precision."""

    def __init__(
        self, grid: Grid, response: Response, plans: dict[bool, Transforms], spent: Spent, share: float
    ) -> None:
        self.size, self.axes = grid.size, len(grid.points)
        self._plans, self._spent, self._share = plans, spent, share
        self._response = response
        self._single = tuple(part.astype(np.float32) for part in self._parts(grid))
        self._double = self._parts(grid)
        weights = np.ravel(grid.parseval_weights) * grid.size
        # displacement of a point under a load on it alone
        self.point = (
            float(weights @ np.ravel(response.normal)),
            float(weights @ self._double[2 if self.axes == 1 else 3]) * grid.size,
        )

    def _parts(self, grid: Grid) -> tuple[FloatArray, ...]:
        """Real factors of the components over the number of points: C_pp, coupling along the axes, C_tt."""
        of, n = self._response, self.size
        flat = [np.ravel(part) / n for part in (of.normal, of.coupling, of.along, of.across)]
        if self.axes == 1:
            coupling = flat[1].copy()
            if grid.points[0] % 2 == 0:
                coupling[-1] = 0.0
            return flat[0], coupling, flat[2]
        q = grid.wavenumbers
        length = np.where(q > 0, q, 1.0)
        even = [np.broadcast_to(component, q.shape) / length for component in grid.wavevectors]
        odd = []
        for axis, direction in enumerate(even):
            kept, points = direction.copy(), grid.points[axis]
            if points % 2 == 0:
                kept[(slice(None),) * axis + (points // 2,)] = 0.0
            odd.append(kept.ravel())
        x, y = (direction.ravel() for direction in even)
        difference = flat[2] - flat[3]
        xx, yy = flat[3] + difference * x**2, flat[3] + difference * y**2
        xx[0] = yy[0] = flat[2][0]
        return flat[0], flat[1] * odd[0], flat[1] * odd[1], xx, difference * odd[0] * odd[1], yy

    @cached_property
    def _work(self) -> dict[bool, tuple[list[Any], list[Any]]]:
        count = 1 + self.axes
        return {
            single: (
                [plan.empty_field() for _ in range(count)],
                [plan.empty_spectrum() for _ in range(count)],
            )
            for single, plan in self._plans.items()
        }

    def __call__(self, x: NDArray[Any], *, single: bool = False) -> FloatArray:
        """Return the response to fields, as new fields in double precision."""
        fields, _ = self._work[single]
        for field, values in zip(fields, x, strict=False):
            field[:] = values
        return np.array(self._respond(len(x), [bool(values.any()) for values in x], single), dtype=np.float64)

    def among(
        self, points: NDArray[Any], x: NDArray[Any], wanted: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """Return the response at points to fields at points, in single precision."""
        fields, _ = self._work[True]
        for field, values in zip(fields, x, strict=False):
            field.fill(0.0)
            field[points] = values
        wanted = points if wanted is None else wanted
        return np.array([field[wanted] for field in self._respond(len(x), [True] * len(x), True)])

    def _respond(self, count: int, live: list[bool], single: bool) -> list[Any]:
        """Replace the first fields of the work space by the response to them."""
        plan, (fields, spectra) = self._plans[single], self._work[single]
        for field, spectrum, is_live in zip(fields[:count], spectra, live, strict=False):
            if is_live:
                plan.transform(field, spectrum)
            else:
                spectrum[:] = 0.0
        parts = self._single if single else self._double
        if count == 1:
            spectra[0] *= parts[0]
        elif self.axes == 1:
            _line(*parts, *spectra)
        else:
            _surface(*parts, *spectra)
        for field, spectrum in zip(fields[:count], spectra, strict=False):
            plan.transform_back(spectrum, field)
        self._spent.pairs += 0.5 * (sum(live) + count) * self._share * (0.5 if single else 1.0)
        return fields[:count]


@kernel(reorder=True)
def _line(a: Any, c: Any, b: Any, p: Any, t: Any) -> None:
    """Replace the transforms of p and t by those of W and u."""
    for k in range(p.size):
        pr, pi, tr, ti, couple = p[k].real, p[k].imag, t[k].real, t[k].imag, c[k]
        p[k] = complex(a[k] * pr + couple * ti, a[k] * pi - couple * tr)
        t[k] = complex(b[k] * tr - couple * pi, b[k] * ti + couple * pr)


@kernel(reorder=True)
def _surface(a: Any, cx: Any, cy: Any, xx: Any, xy: Any, yy: Any, p: Any, tx: Any, ty: Any) -> None:
    """Replace the transforms of p, t_x and t_y by those of W, u_x and u_y."""
    for k in range(p.size):
        pr, pi = p[k].real, p[k].imag
        xr, xi, yr, yi = tx[k].real, tx[k].imag, ty[k].real, ty[k].imag
        p[k] = complex(a[k] * pr + cx[k] * xi + cy[k] * yi, a[k] * pi - cx[k] * xr - cy[k] * yr)
        tx[k] = complex(xx[k] * xr + xy[k] * yr - cx[k] * pi, xx[k] * xi + xy[k] * yi + cx[k] * pr)
        ty[k] = complex(xy[k] * xr + yy[k] * yr - cy[k] * pi, xy[k] * xi + yy[k] * yi + cy[k] * pr)
