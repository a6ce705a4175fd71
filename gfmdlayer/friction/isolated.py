"""The response of a surface without periodic images to tractions in all directions, on a periodic grid.

The kernels of the surface under point loads at a distance r, with e the unit vector from the load, are

    W <- p  g_0[C_WW],        u <- p  -e g_1[C_WU],        W <- t  e.t g_1[C_WU],
    u <- t  g_0[A] t - g_2[B] (2 e (e.t) - t),        A, B = (C_UU +- C_VV)/2,

    g_m[c](r) = int c(q) J_m(q r) q dq/(2 pi),

on a line cos(q x)/pi and sin(q x)/pi in place of J_0 q/(2 pi) and J_1 q/(2 pi). Along one isolated axis of a
surface they are such integrals at each wavenumber q_m along the other. A smooth low pass leaves of c
what reaches the nearest image: this part is integrated, and sampled on a cell of the differences of points.
The rest of c has no images, and is that of the periodic surface. The transform of the sum has the kernels
exactly at all differences within half of the cell; so it serves every contact in a box of half of the cell,
of a periodic axis in all of it, as if the surface had no images, at the cost of the periodic one.

Such spectra are not positive in all waves, and have no relaxing modes. Their memory is that of the tractions,

    C(q, s) = c_0(q) + sum_k c_k(q)/(1 + s T_k)

with times T_k of all waves, and coefficients of any sign by linear least squares in s at each q. A body with
the retardation times of one material has these; others have times that are spaced evenly in their logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.body.isolated import TOLERANCE, LowPass, refuse
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.pair import Pair
from gfmdlayer.body.relaxation import SAME_BRANCH, retardation
from gfmdlayer.body.solid import Boundary
from gfmdlayer.friction.response import CroppedResponse, Response
from gfmdlayer.grid.grid import Grid, shared_grid
from gfmdlayer.grid.ranks import ALONE, Ranks

# Largest error of C(q, s) in creep form, relative to C_WW(q, 0), that is aimed at; times in a factor of e
# that are tried; times at most.
_AIM, _DENSITIES, _MOST = 1e-6, (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0), 120
# Times of the body that are one; parts of shorter and longer times at the ends; Laplace variables in a factor
# of e, and beyond the times.
_SAME, _ENDS, _LAPLACE, _BEYOND = 1e-6, (0.9, 1.2), 3, 30.0
_SUDDEN = 1e9  # over the shortest time, in place of an infinite Laplace variable
_RELEVANT = 1e-9  # part of the stiffness of modes whose times count
_WAVES = 60  # at which times and errors are looked at
_SINGULAR = 1e-13
_SMOOTH_KERNEL = 40  # further terms of a Chebyshev series than half of the phase that it follows


@dataclass(frozen=True, eq=False)
class IsolatedResponse:
    """The response in creep form, C = c_0 + sum_k c_k/(1 + s T_k), on the modes of a grid."""

    times: FloatArray  # T_k, (k,)
    parts: tuple[FloatArray, ...]  # of each component of `CroppedResponse`, (1 + k, *spectral shape)
    plain: tuple[FloatArray, ...]  # of each component of `Response`, likewise
    error: float  # of C(q, s) by the form, relative to C_WW(q, 0)
    ranks: Ranks = ALONE  # the processes that hold the modes

    def held_by(self, grid: Grid) -> IsolatedResponse:
        """Return the response at those modes of the whole grid that this process holds."""
        if grid.is_whole:
            return self
        parts, plain = (
            tuple(part[..., grid.columns].copy() for part in each) for each in (self.parts, self.plain)
        )
        return IsolatedResponse(self.times, parts, plain, self.error, grid.ranks)

    @property
    def is_positive(self) -> bool:
        """Whether pressure presses the surface down in all waves, suddenly and in the end."""
        ends = np.zeros(self.times.size), np.ones(self.times.size)
        return all(self.with_weights(weights).is_positive for weights in ends)

    def beside(self, other: IsolatedResponse) -> IsolatedResponse:
        """Return the response between this surface and one above it, see `Response.beside`."""

        def joined(
            one: Sequence[FloatArray], two: Sequence[FloatArray], odd: set[int]
        ) -> Iterator[FloatArray]:
            for number, (a, b) in enumerate(zip(one, two, strict=True)):
                b = -b if number in odd else b  # the couplings
                yield np.concatenate((a[:1] + b[:1], a[1:], b[1:]))

        of_axes = {1} if len(self.parts) == 3 else {1, 2}
        return IsolatedResponse(
            np.concatenate((self.times, other.times)),
            tuple(joined(self.parts, other.parts, of_axes)),
            tuple(joined(self.plain, other.plain, {1})),
            max(self.error, other.error),
            self.ranks,
        )

    def with_weights(self, weights: NDArray[Any]) -> CroppedResponse:
        """Return c_0 + sum_k weights_k c_k, with one weight or one a mode, (k, modes)."""
        every = np.concatenate((np.ones((1, *weights.shape[1:])), weights))

        def mixed(part: FloatArray) -> NDArray[Any]:
            if weights.ndim == 1:
                return np.asarray(np.tensordot(every, part, 1))
            return np.asarray((every.reshape(part.shape) * part).sum(axis=0))

        plain = Response(*map(mixed, self.plain), ranks=self.ranks)
        return CroppedResponse(tuple(map(mixed, self.parts)), plain)


def without_images(body: Any, grid: Grid, boundary: Boundary | None = None) -> IsolatedResponse:
    """Return the response of a body with `traction_spectrum` on a grid, see the module.

    Parameters
    ----------
    body : Body
        With the method `traction_spectrum`.
    grid : Grid
        Its response is exact for tractions in a box of half of the cell.
    boundary : Boundary, optional
        The isolated axes, by default all, and the datum of one, as of `body.isolated`.

    Raises
    ------
    ValueError
        If the body has no isolated state, or its relaxation no creep form.
    """
    if isinstance(body, Pair):
        return without_images(body.first, grid, boundary).beside(without_images(body.second, grid, boundary))
    boundary = boundary or _all_alone(grid)
    made = _kept if isinstance(body, Layers) else _of_whole  # layers never change
    return made(body, grid.points, grid.period, boundary).held_by(grid)


def _all_alone(grid: Grid) -> Boundary:
    return Boundary((True,) * len(grid.points))


@lru_cache(maxsize=4)
def _kept(
    body: Layers, points: tuple[int, ...], period: tuple[float, ...], boundary: Boundary
) -> IsolatedResponse:
    return _of_whole(body, points, period, boundary)


def _of_whole(
    body: Any, points: tuple[int, ...], period: tuple[float, ...], boundary: Boundary
) -> IsolatedResponse:
    return _without_images(body, shared_grid(points, period), boundary)


def check_isolated(body: Any, grid: Grid, boundary: Boundary | None = None) -> None:
    """Raise the errors of `without_images`."""
    for each in (body.first, body.second) if isinstance(body, Pair) else (body,):
        _form(each, grid, boundary or _all_alone(grid))


def _form(body: Any, grid: Grid, boundary: Boundary) -> CreepForm:
    """Return the creep form of a body on the waves of a grid."""
    refuse(body, grid.period, boundary)
    return CreepForm.of(body, np.pi / max(grid.period), float(grid.wavenumbers.max()))


def _without_images(body: Any, grid: Grid, boundary: Boundary) -> IsolatedResponse:
    form, q = _form(body, grid, boundary), grid.wavenumbers.ravel()
    count, shape = form.times.size + 1, grid.spectral_shape
    coefficients = np.zeros((4, count, q.size))
    coefficients[:, :, 1:] = form.coefficients(q[1:])
    plain = tuple(each.reshape(count, *shape) for each in coefficients)
    passed = LowPass(min(grid.period[axis] for axis in boundary.axes) / 2)
    high = coefficients * (1 - passed(q))
    high[:, :, 0] = 0.0  # all of the mean passes
    if len(boundary.axes) == 2:
        low = _around_a_point(form, grid, passed)
    else:
        low = _along_an_axis(form, grid, passed, boundary)
    axes = tuple(range(1, 1 + len(grid.points)))
    area = math.prod(grid.period) / grid.size
    parts: list[FloatArray] = []
    rest = [Response(*part).factors(grid) for part in high.transpose(1, 0, 2)]
    for number, (kernel, is_odd) in enumerate(low):
        spectrum = area * np.fft.rfftn(kernel, axes=axes)
        others = np.stack([part[number] for part in rest]).reshape(spectrum.shape) * grid.size
        parts.append((spectrum.imag if is_odd else spectrum.real) + others)
    return IsolatedResponse(form.times, tuple(parts), plain, form.error)


def _chebyshev(passed: LowPass, largest: float) -> tuple[FloatArray, Any]:
    """Return distances up to the largest, and what brings a function that is sampled there to others."""
    # The kernels end at the wavenumber `passed.last`: in r they are a short Chebyshev series.
    terms = math.ceil(passed.last * largest / 2) + _SMOOTH_KERNEL
    nodes = np.cos(math.pi * (np.arange(terms) + 0.5) / terms)
    chebyshev = np.polynomial.chebyshev
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, terms - 1))

    def at(r: FloatArray, sampled: FloatArray) -> FloatArray:
        return np.asarray(chebyshev.chebval(2 * r / largest - 1, inverse @ sampled))

    return 0.5 * largest * (1 + nodes), at


def _signs(n: int) -> tuple[IntArray, FloatArray]:
    """Return the distances of n points from the first, in spacings, and their signs."""
    # Of odd kernels, the value at half of the cell is the mean of the two that it could have.
    number = np.fft.fftfreq(n, 1 / n).round().astype(int)
    return np.abs(number), np.sign(number) * (2 * np.abs(number) != n)


def _around_a_point(form: CreepForm, grid: Grid, passed: LowPass) -> Iterator[tuple[FloatArray, bool]]:
    """Yield the kernels of the waves that pass, at the differences of points, and which spectra are odd."""
    from scipy.special import jv

    largest = 0.5 * math.hypot(*grid.period)
    q, weights = passed.rule(min(grid.period), largest)
    WW, WU, UU, VV = form.coefficients(q) * (weights * passed(q))
    r, at_distances = _chebyshev(passed, largest)
    waves = np.outer(r, q)
    orders = ((0, WW), (1, WU), (0, 0.5 * (UU + VV)), (2, 0.5 * (UU - VV)))
    sampled = [jv(m, waves) @ (c * (q / (2 * math.pi))).T for m, c in orders]
    # At the differences of one quadrant; the others are alike.
    every = zip(grid.points, grid.period, strict=True)
    away = np.meshgrid(*(np.arange(n // 2 + 1) * (length / n) for n, length in every), indexing="ij")
    r = np.hypot(*away)
    values = at_distances(r, np.concatenate(sampled, axis=1))
    W, odd, mean, turning = values.reshape(len(sampled), -1, *r.shape)
    (x, sign_x), (y, sy) = map(_signs, grid.points)
    sx, (ex, ey) = sign_x[:, np.newaxis], (np.asarray(x / np.where(r > 0, r, 1.0)) for x in away)

    def everywhere(quadrant: FloatArray) -> FloatArray:
        return np.asarray(quadrant[:, x[:, np.newaxis], y])

    yield everywhere(W), False
    yield -sx * everywhere(ex * odd), True
    yield -sy * everywhere(ey * odd), True
    yield everywhere(mean - (ex**2 - ey**2) * turning), False
    yield -sx * sy * everywhere(2 * ex * ey * turning), False
    yield everywhere(mean + (ex**2 - ey**2) * turning), False


def _along_an_axis(
    form: CreepForm, grid: Grid, passed: LowPass, boundary: Boundary
) -> Iterator[tuple[FloatArray, bool]]:
    """Yield those of a line, or of a surface with one isolated axis."""
    (axis,), datum = boundary.axes, boundary.datum
    (length, n), across = (grid.period[axis], grid.points[axis]), 1 - axis
    is_line = len(grid.points) == 1
    most = 0 if is_line else int(passed.last * grid.period[across] / (2 * math.pi))
    qm = 2 * math.pi * np.arange(most + 1) / (1.0 if is_line else grid.period[across])
    q, weights = passed.rule(length, length / 2, datum)
    magnitude = np.hypot(q, qm[:, np.newaxis])
    along, beside = q / magnitude, qm[:, np.newaxis] / magnitude  # of the unit vector of each wave
    x, at_distances = _chebyshev(passed, length / 2)
    distances, sign = _signs(n)

    def kernels(components: FloatArray, waves: FloatArray) -> FloatArray:
        """Integrate along the axis, (1 + k, rows, points)."""
        sampled = np.tensordot(waves, components, (1, 2)) / math.pi
        flat = at_distances(np.arange(n // 2 + 1) * (length / n), sampled.reshape(len(x), -1))
        return np.asarray(flat.reshape(*sampled.shape[1:], -1)[..., distances])

    c = form.coefficients(magnitude.ravel()).reshape(4, -1, *magnitude.shape)
    WW, WU, UU, VV = c * (weights * passed(magnitude))
    cosines, sines = np.cos(np.outer(x, q)), np.sin(np.outer(x, q))
    even = [WW, UU * along**2 + VV * beside**2, UU * beside**2 + VV * along**2]
    W, own, other = (kernels(each, cosines) for each in even)
    if datum is not None:  # of the mean along the other axis
        far = form.coefficients(q) * (weights * passed(q * datum / passed.distance))
        at_datum = far[[0, 2, 3]] @ np.cos(datum * q) / math.pi
        for kernel, rest in zip((W, own, other), at_datum, strict=True):
            kernel[:, 0] -= rest[:, np.newaxis]
    odd = -sign * kernels(WU * along, sines)
    if is_line:
        yield from ((W[:, 0], False), (odd[:, 0], True), (own[:, 0], False))
        return
    beyond, mixed = kernels(WU * beside, cosines), -sign * kernels((UU - VV) * along * beside, sines)
    number = np.outer(np.arange(most + 1), np.arange(grid.points[across]) / grid.points[across])
    share = np.where(qm > 0, 2, 1)[:, np.newaxis] / grid.period[across]
    cosines, sines = share * np.cos(2 * math.pi * number), share * np.sin(2 * math.pi * number)

    def summed(rows: FloatArray, waves: FloatArray) -> FloatArray:
        """Sum along the other axis, (1 + k, *points)."""
        found = np.tensordot(rows, waves, (1, 0))
        return found if axis == 0 else found.transpose(0, 2, 1)

    yield summed(W, cosines), False
    yield from ((each, True) for each in (summed(odd, cosines), -summed(beyond, sines))[:: 1 - 2 * axis])
    one, two = (summed(each, cosines) for each in (own, other)[:: 1 - 2 * axis])
    yield from ((one, False), (summed(mixed, sines), False), (two, False))


class CreepForm:
    """C_WW, C_WU, C_UU, C_VV of a body as c_0 + sum_k c_k/(1 + s T_k), T_k the same for all waves."""

    def __init__(self, body: Any, times: FloatArray) -> None:
        self._body, self.times = body, times
        self._s: FloatArray = np.zeros(1)
        self._inverse: FloatArray = np.ones((1, 1))
        self.error = 0.0
        if times.size:
            self._s = _laplace(times, 0.0)
            self._inverse = np.asarray(np.linalg.pinv(self._courses(self._s), _SINGULAR), dtype=float)

    @classmethod
    def of(cls, body: Any, longest: float, shortest: float) -> CreepForm:
        """Return the form of the fewest times that has the error that is aimed at, from waves in a range."""
        # Longer waves are the body's below its layers, or too few to matter in the integrals.
        q = np.geomspace(1e-3 * longest, shortest, _WAVES)
        best: CreepForm | None = None
        for times in _candidates(body, q):
            form = cls(body, times)
            form.error = form._missed(q)
            if best is None or form.error < best.error:
                best = form
            if best.error <= _AIM:
                break
        assert best is not None
        if best.error > TOLERANCE:
            raise ValueError(
                f"the relaxation of the body in creep form has an error of {best.error:.1e} with "
                f"{best.times.size} times; must be at most {TOLERANCE:g}: take fewer branches"
            )
        return best

    def coefficients(self, q: FloatArray) -> FloatArray:
        """Return c_0 and c_k of the four components at waves q > 0, (4, 1 + k, nq)."""
        return np.asarray(np.einsum("ks,csq->ckq", self._inverse, compliances(self._body, q, self._s)))

    def _courses(self, s: FloatArray) -> FloatArray:
        return np.column_stack((np.ones(s.size), 1 / (1 + np.outer(s, self.times))))

    def _missed(self, q: FloatArray) -> float:
        """Return the error between the Laplace variables of the fit."""
        if not self.times.size:
            return 0.0
        s = _laplace(self.times, 0.5)
        exact = compliances(self._body, q, s)
        off = np.einsum("sk,ckq->csq", self._courses(s), self.coefficients(q)) - exact
        return float(np.abs(off / exact[0, 0]).max())


def compliances(body: Any, q: FloatArray, s: FloatArray) -> FloatArray:
    """Return C_WW, C_WU, C_UU, C_VV of a body at waves q > 0, (4, ns, nq)."""
    spectrum = body.traction_spectrum(q)
    entries, found = spectrum.in_plane.entries, np.empty((4, s.size, q.size))
    for i, each in enumerate(s):
        K = entries.stiffness(each)
        normal, coupling, along = K[:, 0, 0], K[:, 0, 1], K[:, 1, 1]
        whole = normal * along - coupling**2
        found[:, i] = along / whole, -coupling / whole, normal / whole, 1 / spectrum.across.stiffness(each)
    return found


def _laplace(times: FloatArray, shift: float) -> FloatArray:
    """Return Laplace variables around the times: zero, one much larger, and between; or between those."""
    first, last = 1 / (_BEYOND * times.max()), _BEYOND / times.min()
    count = math.ceil(_LAPLACE * math.log(last / first))
    ratio = math.log(last / first) / count
    between = first * np.exp(ratio * (np.arange(count) + shift))
    return between if shift else np.array([0.0, *between, last, _SUDDEN / times.min()])


def _candidates(body: Any, q: FloatArray) -> Iterator[FloatArray]:
    """Yield times T_k: those of a body that has the same in all waves, and evenly spaced ones."""
    spectrum = body.traction_spectrum(q)
    plane, across = spectrum.in_plane, spectrum.across
    share = (plane.vectors**2).sum(axis=-1) / np.trace(plane.glassy, axis1=-2, axis2=-1)
    relaxing = plane.times[share > _RELEVANT]
    if not relaxing.size:
        yield np.zeros(0)
        return
    found = retardation(across.weights, across.times, across.relaxed, SAME_BRANCH)
    own = np.sort(found.times[found.compliances * across.relaxed > _RELEVANT])
    own = own[np.concatenate(([True], own[1:] > own[:-1] * (1 + _SAME)))] if own.size else own
    if 0 < own.size <= len(plane.times):
        yield own
    # No retardation is longer than the longest relaxation times the largest glassy over relaxed stiffness.
    ratio = np.linalg.eigvals(np.linalg.solve(plane.relaxed, plane.glassy)).real.max(axis=-1)
    longest = max(own.max(initial=0.0), _longest(plane.times, share, ratio))
    first, last = _ENDS[0] * float(relaxing.min()), _ENDS[1] * float(longest)
    for density in _DENSITIES:
        if (count := max(4, math.ceil(density * math.log(last / first)) + 1)) <= _MOST:
            yield np.geomspace(first, last, count)


def _longest(times: FloatArray, share: FloatArray, ratio: FloatArray) -> float:
    """Return a bound of the retardation times from the longest relaxation time at each wave."""
    return float((np.where(share > _RELEVANT, times, 0.0).max(axis=0) * ratio).max())
