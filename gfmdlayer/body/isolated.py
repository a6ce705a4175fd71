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
from gfmdlayer.body.solid import WIDEST
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


@dataclass(frozen=True, eq=False)
class IsolatedBody:
    """A body in a periodic cell, whose response within reach has no periodic images; `isolated` makes one."""

    body: Body  # its stiffness depends only on the magnitude of the wavevector
    period: tuple[float, ...]
    datum: float | None  # of a line: distance from a load at which the surface counts as at rest
    reach: float  # most periods between two pressed points, ((dx/Lx)^2 + (dy/Ly)^2)^(1/2)
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
        most = len(self.number) - 1
        lengths = (*self.period, self.period[0])[:2]  # a line has no waves along y
        components = zip((waves.qx, waves.qy), lengths, strict=True)
        numbers = np.stack([np.abs(q) * (length / (2 * math.pi)) for q, length in components])
        nearest = np.rint(np.minimum(numbers, most + 1))
        low = ((nearest <= most) & (np.abs(nearest - numbers) < 1e-6)).all(axis=0)
        nx, ny = np.where(low, nearest, 0).astype(np.intp)
        return np.where(low, self.number[nx, ny], -1)


def isolated(body: Body, period: tuple[float, ...], datum: float | None = None) -> IsolatedBody:
    """Return a body for a periodic cell, whose response within reach has no periodic images."""
    # `datum`, of a line: distance from a load at which the surface counts as at rest, at least the period.
    # ValueError if the body has no isolated state, or no reach has an error within `TOLERANCE`.
    lengths = tuple(map(float, period))
    if isinstance(body, Layers):  # which never change
        return _kept(body, lengths, datum)
    return _isolated(body, lengths, datum)


def _isolated(body: Body, period: tuple[float, ...], datum: float | None) -> IsolatedBody:
    refuse(body, period, datum)
    fits = []
    for reach in REACHES:
        fits.append(_fit(body, period, datum, reach))
        if fits[-1].error <= TOLERANCE:
            return fits[-1]
    raise ValueError(
        f"the response of the body within {REACHES[-1]:g} periods has an error of {fits[-1].error:.1e} "
        f"without images; must be at most {TOLERANCE:g}{_instead(body, period, datum, REACHES[0])}"
    )


_kept = lru_cache(maxsize=8)(_isolated)


def period_for(body: IsolatedBody, width: float) -> str:
    """Return words on the period for a contact of a width, in periods of the cell; empty if none is found."""
    return _instead(body.body, body.period, body.datum, width)


def _instead(body: Body, period: tuple[float, ...], datum: float | None, width: float) -> str:
    for factor in _PERIODS:
        size = width * factor
        if size <= 1:
            continue
        larger, further = tuple(each * size for each in period), None if datum is None else datum * size
        for reach in REACHES:
            if reach * factor >= 1 and _fit(body, larger, further, reach).error <= TOLERANCE:
                words = ", ".join(f"{each:.3g}" for each in dict.fromkeys(larger))
                return f"; a period of {words} would do"
    return ""


def refuse(body: Body, period: tuple[float, ...], datum: float | None) -> None:
    """Raise ValueError for a body without an isolated state, or one that depends on the direction."""
    q = np.array([_LONGEST, 100 * _LONGEST]) / max(period)
    long = 1 / body.stiffness(q, 0.0)
    if not np.isfinite(long).all() or long[0] * q[0] > 10 * long[1] * q[1]:
        raise ValueError("nothing carries the load of an isolated contact; must be a body on a base")
    if len(period) == 1 and datum is None and long[0] > 10 * long[1]:
        raise ValueError(
            "a line on a halfspace has no depth of its own; must have a datum, the distance at which the "
            f"surface counts as at rest: grid.datum, at least the period, {period[0]:g}"
        )
    if len(period) == 2:
        waves = 2 * math.pi / min(period) * np.array([[1, 0], [0, 1], [0.6, 0.8], [0.8, -0.6]]).T
        K = body.stiffness(Wavevectors.of_components(*waves), 0.0)
        if np.ptp(K) > _DIRECTIONAL * K.max():
            raise ValueError(
                "the stiffness depends on the direction, for which there is no isolated contact; must be the "
                "same in all directions, or grid.boundary: periodic"
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
    """Of the response: points within reach, and its transforms there."""

    q: FloatArray  # (nq,), of the integral over all waves
    integral: FloatArray  # (points, nq)
    waves: FloatArray  # (nw,), magnitudes q > 0 of the cell's waves
    cosines: FloatArray  # (points, nw), weights of their compliances
    low: FloatArray  # (nl,), magnitudes of the lowest waves, that of the mean first
    lowest: FloatArray  # (points, nl), weights of their compliances
    number: IntArray  # place of a lowest wave by (|nx|, |ny|); -1 where there is none


def _nodes(period: tuple[float, ...], datum: float | None, reach: float) -> _CellNodes:
    from scipy.special import j0

    axes, shortest = len(period), min(period)
    square, lengths = axes == 2 and period[0] == period[1], (*period, shortest)[:2]
    passed = LowPass((1 - reach) * shortest)  # the nearest image is so far from a point within reach
    side = reach * np.sin(math.pi / 2 * (np.arange(_POINTS) + 0.5) / _POINTS)
    x, y = (np.ravel(each) for each in np.meshgrid(side, side if axes == 2 else 0.0, indexing="ij"))
    some = (np.hypot(x, y) <= reach) & ((x >= y) | (not square))
    x, y = x[some] * lengths[0], y[some] * lengths[1]

    q, weights = passed.rule(shortest, reach * max(period), datum)
    if axes == 2:
        integral = j0(np.outer(np.hypot(x, y), q)) * (weights * passed(q) * q / (2 * math.pi))
    else:
        integral = np.cos(np.outer(x, q)) * (weights * passed(q) / math.pi)
        if datum is not None:
            integral -= np.cos(datum * q) * (weights * passed(q * datum / passed.distance) / math.pi)

    most = [max(int(passed.last * each / (2 * math.pi)), _LOWEST[axes]) for each in period] + [0] * (2 - axes)
    nx, ny = (np.ravel(n) for n in np.meshgrid(*(np.arange(n + 1) for n in most), indexing="ij"))
    qx, qy = 2 * math.pi * nx / lengths[0], 2 * math.pi * ny / lengths[1]
    waves, alike = np.hypot(qx, qy), np.where(nx > 0, 2, 1) * np.where(ny > 0, 2, 1)
    cosines = np.cos(np.outer(x, qx)) * np.cos(np.outer(y, qy)) * (alike / math.prod(period))
    low = nx**2 + ny**2 <= _LOWEST[axes] ** 2
    kinds = np.stack((np.maximum(nx, ny), np.minimum(nx, ny)) if square else (nx, ny), axis=1)[low]
    different, first, of = np.unique(kinds, axis=0, return_index=True, return_inverse=True)
    lowest = np.zeros((len(different), x.size))
    np.add.at(lowest, of.ravel(), cosines[:, low].T)
    number = np.full((_LOWEST[axes] + 1,) * 2, -1, dtype=np.intp)
    number[nx[low], ny[low]] = of.ravel()
    felt = (waves > 0) & ((waves <= passed.last) | low)
    others = cosines * (passed(waves) - low)
    return _CellNodes(q, integral, waves[felt], others[:, felt], waves[low][first], lowest.T, number)


def _fit(body: Body, period: tuple[float, ...], datum: float | None, reach: float) -> IsolatedBody:
    """Return the body of the least error within reach."""
    from scipy.optimize import nnls

    nodes = _nodes(period, datum, reach)
    s, times = _times(body, nodes.low[1:], min(period))
    smooth = nodes.integral @ np.stack([1 / body.stiffness(nodes.q, each) for each in s], axis=1)
    others = nodes.cosines @ np.stack([1 / body.stiffness(nodes.waves, each) for each in s], axis=1)
    size = np.abs(smooth).max(axis=0)
    least = _STIFFEST / body.stiffness(np.where(nodes.low > 0, nodes.low, nodes.low[1]), s[-1])
    target = (smooth - others - (nodes.lowest @ least)[:, np.newaxis]) / size
    course = np.vstack((np.ones(s.size), 1 / (1 + np.outer(times, s)))) / size
    # The unknowns are the product of waves and times: both factors are compressed to what they are worth.
    of_points, of_waves = _compressed(nodes.lowest)
    of_s, of_times = _compressed(course.T)
    system = np.kron(of_waves, of_times)
    length = np.linalg.norm(system, axis=0)
    product, _ = nnls(system / length, (of_points.T @ target @ of_s).ravel(), maxiter=20 * length.size)
    creep = (product / length).reshape(least.size, -1)
    error = float(np.abs(nodes.lowest @ creep @ course - target).max())
    creep[:, 0] += least
    modes = [relaxation(c[0], c[1:][c[1:] > 0], times[c[1:] > 0]) for c in creep]
    most = max(own.size for own, _ in modes)
    weights, taus = np.zeros((most, len(creep))), np.ones((most, len(creep)))
    for i, (own, tau) in enumerate(modes):
        weights[: own.size, i], taus[: own.size, i] = own, tau
    low = Spectrum(1 / creep.sum(axis=1), weights, taus)
    return IsolatedBody(body, period, datum, reach, error, low, nodes.number)


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
