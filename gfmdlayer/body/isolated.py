"""A periodic body that answers like the isolated one: contact without periodic images, on a periodic grid.

Two pressed points are at most the reach apart. The contact problems, the memory and the energies of a run use
the response G(x, s) of the surface to a point load within reach alone. So any periodic body of this response,
whatever it is beyond, has the isolated contact. It is the given body with other lowest waves: with the
compliances C = 1/K, and the area A of the cell,

    1/A sum_low C~(q, s) cos(q x) = G(x, s) - 1/A sum_high C(q, s) cos(q x)            within reach

The reach is an ellipse in the shape of the cell; its axes are a part of the period below 1/2, so that no
point of it is the image of another. Positive C~ nearly exist, since G is itself an integral over waves with
C > 0, and the lattice of q is finer than the reach requires: C~ is a rule of quadrature with positive
weights. In the form of creep, with retardation times T_k that the body has,

    C~(q, s) = c_0(q) + sum_k c_k(q)/(1 + s T_k),          c_0 >= `_STIFFEST` C(q, inf),    c_k >= 0

and c follows from least squares. As relaxing modes (`network.relaxation`) C~ passes through histories,
solvers and energies like any body that carries a mean pressure.

The right-hand side has no singularity. A smooth low pass p(q), one near q = 0, leaves of G and of the sum
over all waves what does not end before the nearest image; the rest of the two is equal. So it is

    int p C J_0(q r) q dq/(2 pi) - 1/A sum_(q > 0) p C cos(q x) + 1/A sum_(low, q > 0) C cos(q x)

with short sums. On a line the integral is int p C cos(q x) dq/pi, and the displacement of a body on a
halfspace, known up to a constant, is counted from the one at a distance from the load, the datum.

A surface may be isolated along one axis and periodic along the other. Loads with a wavenumber q_m along the
periodic axis move the surface with the same wavenumber: each q_m is a line of its own, with the compliance
C((q^2 + q_m^2)^(1/2)) of waves q along the isolated axis. A line is such a surface with q_m = 0 alone. Only
for q_m = 0 does the displacement need a datum, which is of its mean along the periodic axis. The others end
like exp(-q_m x) on a halfspace, and those whose images do not count keep C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import BoolArray, FloatArray, IntArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.network import relaxation
from gfmdlayer.body.relaxation import SAME_BRANCH, Spectrum, retardation
from gfmdlayer.body.solid import WIDEST, Boundary
from gfmdlayer.body.wavevectors import Wavevectors

# Largest error of G within reach, relative to the largest value of its smooth part.
TOLERANCE = 1e-3

# Reach over period: the largest for which the error is below the tolerance. Periods that are tried for a
# contact that needs another one, over its width.
REACHES = (WIDEST, 0.36, 0.3, 0.24)
_PERIODS = (2.4, 3, 4, 6, 9, 14, 20)

# Waves over the period that are changed, at most, of a surface and of a line.
_LOWEST = {2: 6, 1: 10}

# Least part of the compliance against sudden loads that stays: a mode that is much stiffer would relax in a
# much shorter time than those of the body, which adaptive steps would resolve.
_STIFFEST = 0.5

# The low pass is erfc(_SMOOTH (q/q_0 - 1))/2, and its transform falls by as much at the nearest image.
_SMOOTH = 4.0

# Points along an axis of the reach; retardation times that are distinguished, as differences of logarithms;
# those with less of the compliance are left out; Laplace variables in a decade.
_POINTS, _DISTINCT, _LEAST, _DECADE = 12, 0.25, 1e-4, 6

# Further times between those of the body and to so many times the longest: with them fewer bodies need a
# smaller reach.
_BETWEEN, _LATER = 24, 5.0

# Of waves over the period, where the body is asked for its limit of long waves.
_LONGEST = 1e-8

_SUDDEN = 1e9  # over the shortest relaxation time, in place of an infinite Laplace variable
_SINGULAR = 1e-9  # singular values that are left out, over the largest
_ORDER = 10  # of Gauss's rule
_DIRECTIONAL = 1e-6  # relative difference of K along two directions
_NO_IMAGES = 1e-3 * TOLERANCE  # of the response, below which the images of waves along an axis do not count


@dataclass(frozen=True, eq=False)
class IsolatedBody:
    """A body in a periodic cell, whose response within reach has no periodic images; `isolated` makes one."""

    body: Body  # its stiffness depends on the magnitude of the wavevector; of one axis, on the direction too
    period: tuple[float, ...]
    boundary: Boundary
    # Most periods between two pressed points, ((dx/Lx)^2 + (dy/Ly)^2)^(1/2), or along the one isolated axis.
    reach: float
    error: float  # largest error of the response to a point load within reach, over its smooth part
    low: Spectrum  # relaxing modes of the lowest waves, (waves,)
    number: IntArray  # place of a wave in `low` by its numbers over the period, (|nx|, |ny|); -1: none

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0): the cell carries its mean pressure."""
        return float(self.low.relaxed[self.number[0, 0]])

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s) at waves of the cell, see `Body`."""
        return self.spectrum(waves).stiffness(s)

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes at waves of the cell: the lowest have rows of their own."""
        waves = Wavevectors.of(waves)
        at, own = self._at(waves), self.body.spectrum(waves)
        low = at >= 0
        relaxed = np.where(low, self.low.relaxed[at], own.relaxed)
        changed = np.where(low, self.low.weights[:, at], 0.0)
        weights = np.concatenate((np.where(low, 0.0, own.weights), changed))
        times = np.concatenate((own.times, np.where(low, self.low.times[:, at], 1.0)))
        return Spectrum(relaxed, weights, times, own.error)

    def _at(self, waves: Wavevectors) -> IntArray:
        """Place of each wave among the lowest; -1 for the others."""
        most = np.reshape(self.number.shape, (2, *[1] * waves.qx.ndim)) - 1
        lengths = (*self.period, self.period[0])[:2]  # a line has no waves along y
        components = zip((waves.qx, waves.qy), lengths, strict=True)
        numbers = np.stack([np.abs(q) * (length / (2 * math.pi)) for q, length in components])
        nearest = np.rint(np.minimum(numbers, most + 1))
        low = ((nearest <= most) & (np.abs(nearest - numbers) < 1e-6)).all(axis=0)
        nx, ny = np.where(low, nearest, 0).astype(np.intp)
        return np.where(low, self.number[nx, ny], -1)


def isolated(body: Body, period: tuple[float, ...], boundary: Boundary | None = None) -> IsolatedBody:
    """Return a body for a periodic cell, whose response within reach has no periodic images."""
    # Without a `boundary` no axis has images. ValueError if the body has no isolated state, or no reach has
    # an error within `TOLERANCE`.
    lengths = tuple(map(float, period))
    boundary = boundary or Boundary((True,) * len(lengths))
    if isinstance(body, Layers):  # which never change
        return _kept(body, lengths, boundary)
    return _isolated(body, lengths, boundary)


def _isolated(body: Body, period: tuple[float, ...], boundary: Boundary) -> IsolatedBody:
    refuse(body, period, boundary, alike=len(boundary.axes) == 2)
    fits = []
    for reach in REACHES:
        fits.append(_fit(body, period, boundary, reach))
        if fits[-1].error <= TOLERANCE:
            return fits[-1]
    raise ValueError(
        f"the response of the body within {REACHES[-1]:g} periods has an error of {fits[-1].error:.1e} "
        f"without images; must be at most {TOLERANCE:g}{_instead(body, period, boundary, REACHES[0])}"
    )


_kept = lru_cache(maxsize=8)(_isolated)


def period_for(body: IsolatedBody, width: float) -> str:
    """Return words on the period for a contact of a width, in periods of the cell; empty if none is found."""
    return _instead(body.body, body.period, body.boundary, width)


def _instead(body: Body, period: tuple[float, ...], boundary: Boundary, width: float) -> str:
    for factor in _PERIODS:
        if width * factor <= 1:
            continue
        larger, further = boundary.widened(period, width * factor)
        for reach in REACHES:
            if reach * factor >= 1 and _fit(body, larger, further, reach).error <= TOLERANCE:
                return would_do(larger, boundary)
    return ""


def would_do(period: tuple[float, ...], boundary: Boundary) -> str:
    """Return words on a period that a contact needs."""
    along = "" if all(boundary.isolated) else f" along {'xy'[boundary.axes[0]]}"
    lengths = ", ".join(f"{length:.3g}" for length in dict.fromkeys(period[axis] for axis in boundary.axes))
    return f"; a period{along} of {lengths} would do"


def refuse(body: Body, period: tuple[float, ...], boundary: Boundary, *, alike: bool = True) -> None:
    """Raise ValueError for a body without an isolated state, or one that depends on the direction.

    One that need not be `alike` in all directions has to be its own mirror image along the axes.
    """
    q = np.array([_LONGEST, 100 * _LONGEST]) / max(period)
    long = 1 / body.stiffness(q, 0.0)
    if not np.isfinite(long).all() or long[0] * q[0] > 10 * long[1] * q[1]:
        raise ValueError("nothing carries the load of an isolated contact; must be a body on a base")
    if len(boundary.axes) == 1 and boundary.datum is None and long[0] > 10 * long[1]:
        raise ValueError(
            "a line on a halfspace has no depth of its own; must have a datum, the distance at which the "
            f"surface counts as at rest: grid.datum, at least the period, {period[boundary.axes[0]]:g}"
        )
    if len(period) == 2:
        waves = 2 * math.pi / min(period) * np.array([[1, 0], [0, 1], [0.6, 0.8], [0.8, -0.6]]).T
        K = body.stiffness(Wavevectors.of_components(*waves), 0.0)
        if alike and np.ptp(K) > _DIRECTIONAL * K.max():
            raise ValueError(
                "the stiffness depends on the direction, for which there is no isolated contact; must be the "
                "same in all directions, or grid.boundary: periodic"
            )
        mirrored = body.stiffness(Wavevectors.of_components(waves[0], -waves[1]), 0.0)
        if np.abs(mirrored - K).max() > _DIRECTIONAL * K.max():
            raise ValueError(
                "the stiffness along x and y is no mirror image of itself, for which there is no isolated "
                "axis; must be one, such as of a crystal with twofold axes along x and y, or periodic"
            )


@dataclass(frozen=True)
class LowPass:
    """A smooth low pass of waves: what it leaves out has no response at a distance and beyond."""

    distance: float

    def __call__(self, q: FloatArray) -> FloatArray:
        """Return the part of waves that passes."""
        from scipy.special import erfc

        return np.asarray(0.5 * erfc(_SMOOTH * (q / (self.last / 2) - 1)))

    @property
    def last(self) -> float:
        """Wavenumber beyond which nothing passes."""
        return 2 * (2 * _SMOOTH**2 / self.distance)

    def rule(
        self, period: float, largest: float, datum: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return nodes q > 0 and weights for integrals of the waves that pass, up to the largest distance.

        With a datum they also serve the low pass for that distance, of q datum/distance.
        """
        edges = [*np.geomspace(_LONGEST / period, self.last, 40), *np.arange(0, self.last, 5 / largest)]
        if datum is not None:
            far = self.last * self.distance / datum
            edges += [*np.geomspace(_LONGEST / datum, far, 40), *np.arange(0, far, 5 / datum)]
        cuts = np.unique([0.0, *edges])[:, np.newaxis]
        half = np.diff(cuts, axis=0) / 2
        nodes, shares = np.polynomial.legendre.leggauss(_ORDER)
        return (half * (nodes + 1) + cuts[:-1]).ravel(), (half * shares).ravel()


class _CellNodes(NamedTuple):
    """Of waves that are fitted together: points within reach, and their transforms there."""

    share: int  # waves of the cell that each of them stands for
    q: FloatArray | Wavevectors  # (nq,), of the integral over all waves; magnitudes, or with their directions
    integral: FloatArray  # (points, nq)
    waves: FloatArray | Wavevectors  # (nw,), q > 0 of the cell
    cosines: FloatArray  # (points, nw), weights of their compliances
    low: Wavevectors  # (nl,), the lowest waves, the longest first
    lowest: FloatArray  # (points, nl), weights of their compliances


def _in_an_ellipse(period: tuple[float, ...], reach: float) -> tuple[list[_CellNodes], IntArray]:
    """Return the nodes of a surface that is isolated along both axes, and `IsolatedBody.number`."""
    from scipy.special import j0

    shortest, square, fewest = min(period), period[0] == period[1], _LOWEST[2]
    passed = LowPass((1 - reach) * shortest)  # the nearest image is so far from a point within reach
    side = reach * np.sin(math.pi / 2 * (np.arange(_POINTS) + 0.5) / _POINTS)
    x, y = (np.ravel(each) for each in np.meshgrid(side, side, indexing="ij"))
    some = (np.hypot(x, y) <= reach) & ((x >= y) | (not square))
    x, y = x[some] * period[0], y[some] * period[1]

    q, weights = passed.rule(shortest, reach * max(period))
    integral = j0(np.outer(np.hypot(x, y), q)) * (weights * passed(q) * q / (2 * math.pi))

    most = [max(int(passed.last * each / (2 * math.pi)), fewest) for each in period]
    nx, ny = (np.ravel(n) for n in np.meshgrid(*(np.arange(n + 1) for n in most), indexing="ij"))
    qx, qy = 2 * math.pi * nx / period[0], 2 * math.pi * ny / period[1]
    waves, alike = np.hypot(qx, qy), np.where(nx > 0, 2, 1) * np.where(ny > 0, 2, 1)
    cosines = np.cos(np.outer(x, qx)) * np.cos(np.outer(y, qy)) * (alike / math.prod(period))
    low = nx**2 + ny**2 <= fewest**2
    kinds = np.stack((np.maximum(nx, ny), np.minimum(nx, ny)) if square else (nx, ny), axis=1)[low]
    different, first, of = np.unique(kinds, axis=0, return_index=True, return_inverse=True)
    lowest = np.zeros((len(different), x.size))
    np.add.at(lowest, of.ravel(), cosines[:, low].T)
    number = np.full((fewest + 1,) * 2, -1, dtype=np.intp)
    number[nx[low], ny[low]] = of.ravel()
    felt = (waves > 0) & ((waves <= passed.last) | low)
    others = cosines * (passed(waves) - low)
    own = Wavevectors.of(waves[low][first])
    nodes = _CellNodes(1, q, integral, waves[felt], others[:, felt], own, lowest.T)
    return [nodes], number


def _along_an_axis(
    period: tuple[float, ...], boundary: Boundary, reach: float
) -> tuple[list[_CellNodes], IntArray]:
    """Return the nodes of a line, or of each wavenumber along the other axis, and `IsolatedBody.number`."""
    (axis,), datum, fewest = boundary.axes, boundary.datum, _LOWEST[1]
    length, across = period[axis], [each for i, each in enumerate(period) if i != axis]
    passed = LowPass((1 - reach) * length)
    x = length * reach * np.sin(math.pi / 2 * (np.arange(_POINTS) + 0.5) / _POINTS)
    q, weights = passed.rule(length, reach * length, datum)
    n = np.arange(max(int(passed.last * length / (2 * math.pi)), fewest) + 1)
    low, alike = n <= fewest, np.where(n > 0, 2, 1)
    qx = np.asarray(2 * math.pi / length * n, dtype=float)
    waves_along, cosines_along = np.cos(np.outer(x, q)), np.cos(np.outer(x, qx)) * (alike / length)
    rows = []
    for m in range(1 + int(passed.last * across[0] / (2 * math.pi)) if across else 1):
        qm = 2 * math.pi * m / across[0] if m else 0.0
        every, waves = np.hypot(q, qm), np.hypot(qx, qm)
        integral = waves_along * (weights * passed(every) / math.pi)
        if datum is not None and not m:
            integral -= np.cos(datum * q) * (weights * passed(q * datum / passed.distance) / math.pi)
        felt = (waves > 0) & ((waves <= passed.last) | low)
        others = (cosines_along * (passed(waves) - low))[:, felt]
        share, lowest = 2 if m else 1, cosines_along[:, low]
        nodes = (_beside(axis, each, qm) for each in (q, qx[felt], qx[low]))
        rows.append(_CellNodes(share, next(nodes), integral, next(nodes), others, next(nodes), lowest))
    number = np.arange(len(rows) * (fewest + 1), dtype=np.intp).reshape(len(rows), fewest + 1)
    return rows, number if axis == 1 else number.T


def _beside(axis: int, along: FloatArray, across: float) -> Wavevectors:
    """Return the waves with these components along an axis and across it."""
    components = along, np.full(along.shape, across)
    return Wavevectors.of_components(*components[:: 1 - 2 * axis])


def _fit(body: Body, period: tuple[float, ...], boundary: Boundary, reach: float) -> IsolatedBody:
    """Return the body of the least error within reach."""
    if len(boundary.axes) == 2:
        every, number = _in_an_ellipse(period, reach)
    else:
        every, number = _along_an_axis(period, boundary, reach)
    low = np.concatenate([nodes.low.magnitude for nodes in every])
    s, times = _times(body, low[low > 0], min(period[axis] for axis in boundary.axes))
    smooth = [nodes.integral @ _compliance(body, nodes.q, s) for nodes in every]
    size = np.abs(sum(nodes.share * each for nodes, each in zip(every, smooth, strict=True))).max(axis=0)
    course = np.vstack((np.ones(s.size), 1 / (1 + np.outer(times, s)))) / size
    fits, kept, error, count = [], [], 0.0, 0
    for nodes, whole in zip(every, smooth, strict=True):
        target = (whole - nodes.cosines @ _compliance(body, nodes.waves, s)) / size
        if nodes.low.magnitude.min() > 0:
            images = target - nodes.lowest @ _compliance(body, nodes.low, s) / size
            if np.abs(images).max() <= _NO_IMAGES:
                kept.append(np.full(nodes.lowest.shape[1], -1))
                continue
        creep, missed = _creep(body, nodes, s[-1], target, course)
        fits.append(creep)
        kept.append(count + np.arange(nodes.lowest.shape[1]))
        error, count = error + nodes.share * missed, count + nodes.lowest.shape[1]
    modes = [relaxation(c[0], c[1:][c[1:] > 0], times[c[1:] > 0]) for creep in fits for c in creep]
    most = max(own.size for own, _ in modes)
    weights, taus = np.zeros((most, len(modes))), np.ones((most, len(modes)))
    for i, (own, tau) in enumerate(modes):
        weights[: own.size, i], taus[: own.size, i] = own, tau
    changed = Spectrum(1 / np.concatenate(fits).sum(axis=1), weights, taus)
    places = np.where(number >= 0, np.concatenate(kept)[number], -1)
    return IsolatedBody(body, period, boundary, reach, error, changed, places)


def _compliance(body: Body, q: FloatArray | Wavevectors, s: FloatArray) -> FloatArray:
    """Return C(q, s) of a body, (nq, ns)."""
    return np.stack([1 / body.stiffness(q, each) for each in s], axis=1)


def _creep(
    body: Body, nodes: _CellNodes, sudden: float, target: FloatArray, course: FloatArray
) -> tuple[FloatArray, float]:
    """Return c_0 and c_k of the lowest waves, (nl, 1 + k), and their error within reach."""
    from scipy.optimize import nnls

    # The longest wave may have much less than the body's own compliance, which that of a mean is without end.
    some = np.arange(nodes.lowest.shape[1])
    some[0] = 1
    longest = Wavevectors.of_components(nodes.low.qx[some], nodes.low.qy[some])
    least = _STIFFEST / body.stiffness(longest, sudden)
    target = target - np.outer(nodes.lowest @ least, course[0])
    # The unknowns are the product of waves and times: both factors are compressed to what they are worth.
    of_points, of_waves = _compressed(nodes.lowest)
    of_s, of_times = _compressed(course.T)
    system = np.kron(of_waves, of_times)
    length = np.linalg.norm(system, axis=0)
    product, _ = nnls(system / length, (of_points.T @ target @ of_s).ravel(), maxiter=20 * length.size)
    creep = (product / length).reshape(least.size, -1)
    error = float(np.abs(nodes.lowest @ creep @ course - target).max())
    creep[:, 0] += least
    return creep, error


def _times(body: Body, low: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Return Laplace variables, and the retardation times of the body in the lowest waves and longer ones."""
    q = np.concatenate((np.geomspace(1e-4 / period, low.min(), 60), np.geomspace(low.min(), low.max(), 20)))
    modes = body.spectrum(q)
    J, T, *_ = retardation(modes.weights, modes.times, modes.relaxed, SAME_BRANCH)
    T = np.sort(T[J * modes.relaxed > _LEAST])
    if not T.size:
        return np.zeros(1), np.zeros(0)
    ratio, distinct = math.exp(_DISTINCT), []
    rest = T
    while rest.size:
        near, rest = rest[rest <= rest[0] * ratio], rest[rest > rest[0] * ratio]
        alike = near[-1] <= near[0] * math.sqrt(ratio)
        distinct += [math.sqrt(near[0] * near[-1])] if alike else [near[0], near[-1]]
    between = min(_BETWEEN, math.ceil(math.log(_LATER * T[-1] / T[0]) / _DISTINCT))
    times = np.unique([*distinct, *np.geomspace(T[0], _LATER * T[-1], between)])
    shortest = modes.times[modes.weights > _LEAST * modes.glassy].min()
    number = math.ceil(_DECADE * math.log10(1e3 * T[-1] / shortest))
    s = np.geomspace(0.03 / T[-1], 30 / shortest, number)
    return np.array([0.0, *s, _SUDDEN / shortest]), times


def _compressed(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return U and S V^T of a matrix, without negligible singular values."""
    U, values, V = np.linalg.svd(matrix, full_matrices=False)
    kept: BoolArray = values > _SINGULAR * values[0]
    return U[:, kept], values[kept, np.newaxis] * V[kept]
