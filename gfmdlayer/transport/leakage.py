r"""Stationary flow of a thin fluid film through the gap of a contact, by the Reynolds equation.

    div(g^3 grad P) = 0 where g > 0, no flow through contact        (Reynolds, Phil. Trans. 177 (1886) 157)

In a periodic cell P = -G.x + p(x, y) with a periodic p and the mean drop per length G. The mean flow per
width is q = K.G/(12 eta) with a symmetric tensor K [length^3], which depends on neither fluid nor pressure:
K = h^3 between plates at a distance h.

Finite volumes around the points and a five-point stencil: a face between a and b has the conductance
k(a, b) h_across/h_along, and none if either point is in contact. Mass is conserved to the solver's precision.
With the harmonic mean, k = 2 a^3 b^3/(a^3 + b^3), a coarse throat conducts too little, with the linear mean,
k = 2 a^2 b^2/(a + b), too much; their difference estimates the error. Only clusters that wind around the cell
carry a flow (`percolation`): without one, K is exactly zero.

A line has closed forms: K_xx = 1/mean(g^-3) across the ridges, 0 with any contact; K_yy = mean(g^3) along
them.

Valid for small slopes, an incompressible fluid, a gap wide against molecules, a Reynolds number times the
slope below 1. K is one way: of a gap that the fluid has not lifted.

A seal of many cells, under the nominal pressure p0, has the fluid pressure P that falls along it from the
drop D to 0. A uniform P presses the surface everywhere and does not deform it beyond a mean displacement: a
cell is in contact as under the load p0 - P. The flow through all cells is the same, K(p0 - P) dP/dx, so that

    12 eta q length = integral of K(p0 - P) over P from 0 to D      (`mean_under_fluid`)

solves the coupled problem without an iteration along the seal. It leaves out that P differs from its mean
within a cell, by about D over the number of cells along the seal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.grid.grid import finer
from gfmdlayer.transport import LARGEST_DIRECT
from gfmdlayer.transport.percolation import Clusters, Throat, clusters

Mean = Literal["harmonic", "linear"]
# Contact area at which paths close: Dapp, Luecke, Persson & Mueser, Phys. Rev. Lett. 108 (2012) 244301.
THRESHOLD = 0.42
_RESIDUAL = 1e-9  # of the iterative solver, relative to the largest source
_MOST_ITERATIONS = 1000
_STRONG = ("symmetric", {"theta": 0.08})


@dataclass(frozen=True)
class Flow:
    """Flow through a gap; the last two fields are empty for a line."""

    tensor: FloatArray  # K, (2, 2) [length^3]
    # Spread of the flow through the cross-sections, relative to their mean, (2,); 0 without a flow.
    imbalance: FloatArray
    # Pressure under a drop along x, and along y, over the drop across the cell, (2, nx, ny); 0 in the middle
    # of the cell on average, NaN in contact and where nothing flows.
    pressure: FloatArray
    # Components along x and y of 12 eta q/G under a drop along x, and along y, (2, 2, nx, ny) [length^3];
    # their means are the columns of K.
    flow: FloatArray


def numbers_of(flow: Flow) -> dict[str, float]:
    """Return the components of K, the hydraulic gaps and the imbalance by the names of their columns."""
    K = flow.tensor
    numbers = {f"flow_{a}{b}": float(K["xy".index(a), "xy".index(b)]) for a, b in ("xx", "xy", "yy")}
    numbers |= {f"hydraulic_gap_{a}": float(np.cbrt(K[i, i])) for i, a in enumerate("xy")}
    return numbers | {"flow_imbalance": float(flow.imbalance.max())}


def flow_through(gap: FloatArray, period: Sequence[float], mean: Mean = "harmonic") -> Flow:
    """Return the flow through a gap (nx,) or (nx, ny), 0 in contact, over a cell of these lengths."""
    gap = np.asarray(gap, dtype=float)
    if gap.ndim == 1:
        across = 0.0 if gap.min() <= 0 else 1.0 / float(np.mean(gap**-3.0))
        tensor = np.diag([across, float(np.mean(gap**3))])
        return Flow(tensor, np.zeros(2), np.empty((2, 0, 0)), np.empty((2, 2, 0, 0)))
    labelled = clusters(gap > 0)
    if not labelled.winds.any():
        nowhere = np.full((2, *gap.shape), np.nan)
        return Flow(np.zeros((2, 2)), np.zeros(2), nowhere, np.zeros((2, *nowhere.shape)))
    return _of_clusters(gap, (period[0], period[1]), mean, labelled)


def _of_clusters(gap: FloatArray, period: tuple[float, float], mean: Mean, labelled: Clusters) -> Flow:
    spacing = period[0] / gap.shape[0], period[1] / gap.shape[1]
    active, scale = np.logical_or(*labelled.winds), float(gap.max())
    k = _conductances(np.where(active, gap / scale, 0.0), spacing, mean)
    # Under a drop along an axis only the clusters that wind along it carry a flow.
    inside = [labelled.winds[axis] for axis in (0, 1)]
    sources = [
        np.where(inside[axis], np.roll(k[axis], 1, axis) - k[axis], 0.0)[active] * spacing[axis]
        for axis in (0, 1)
    ]
    pressures = np.full((2, *gap.shape), np.nan)
    flows, tensor, imbalance = np.zeros((2, 2, *gap.shape)), np.zeros((2, 2)), np.zeros(2)
    drops: list[list[FloatArray]] = []
    for axis, solved in enumerate(_solved(k, active, gap, labelled.label, sources)):
        p = np.zeros(gap.shape)
        p[active] = solved
        own = [inside[axis] * (p - np.roll(p, -1, c) + spacing[c] * (c == axis)) for c in (0, 1)]
        drops.append(own)
        for c in (0, 1):  # through the faces; at a point the mean of its two faces
            through = k[c] * own[c] * scale**3 / spacing[1 - c]
            flows[axis, c] = (through + np.roll(through, 1, c)) / 2
        sections = (k[axis] * own[axis]).sum(axis=1 - axis)
        imbalance[axis] = np.ptp(sections) / sections.mean() if inside[axis].any() else 0.0
        x = (np.arange(gap.shape[axis]) * spacing[axis] - period[axis] / 2)[:, np.newaxis]
        total = np.where(inside[axis], p - (x if axis == 0 else x.T), np.nan)
        if inside[axis].any():
            pressures[axis] = (total - np.nanmean(total)) / period[axis]
    for a in (0, 1):
        for c in (0, 1):  # by dissipation: its error is the square of that of the pressure
            dissipated = sum(float((k[f] * drops[a][f] * drops[c][f]).sum()) for f in (0, 1))
            tensor[a, c] = dissipated / math.prod(period) * scale**3
    return Flow(tensor, imbalance, pressures, flows)


def _conductances(gap: FloatArray, spacing: tuple[float, float], mean: Mean) -> list[FloatArray]:
    """Conductances of the faces after each point, along x and along y; 0 beside contact."""
    conductances = []
    for axis in (0, 1):
        a, b = gap, np.roll(gap, -1, axis)
        both = (a > 0) & (b > 0)
        k = np.zeros(gap.shape)
        a, b = a[both], b[both]
        k[both] = 2 * a**2 * b**2 / (a + b) if mean == "linear" else 2 / (a**-3.0 + b**-3.0)
        conductances.append(k * spacing[1 - axis] / spacing[axis])
    return conductances


def _solved(
    k: Sequence[FloatArray], active: BoolArray, gap: FloatArray, label: Any, sources: Sequence[FloatArray]
) -> Iterator[FloatArray]:
    """Solve for the pressures of the active points, for each of the sources."""
    from scipy import sparse

    number = np.cumsum(active.ravel()).reshape(active.shape) - 1
    faces = [k[axis] > 0 for axis in (0, 1)]
    i = np.concatenate([number[faces[axis]] for axis in (0, 1)]).astype(np.int32)
    j = np.concatenate([np.roll(number, -1, axis)[faces[axis]] for axis in (0, 1)]).astype(np.int32)
    value = np.concatenate([k[axis][faces[axis]] for axis in (0, 1)])
    count = int(active.sum())
    diagonal = np.bincount(i, value, count) + np.bincount(j, value, count)
    # The pressure of a cluster is free up to a constant: 0 at its widest point, held there by a spring.
    order = np.argsort(-gap[active])
    held = order[np.unique(label[active][order], return_index=True)[1]]
    diagonal[held] *= 2
    own = np.arange(count, dtype=np.int32)
    entries = np.concatenate((-value, -value, diagonal))
    places = np.concatenate((i, j, own)), np.concatenate((j, i, own))
    matrix = sparse.coo_matrix((entries, places), shape=(count, count)).tocsc()
    del i, j, value, entries, places
    if active.size > LARGEST_DIRECT and find_spec("pyamg"):
        yield from _by_multigrid(matrix.tocsr(), sources)
        return
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    yield from (factors.solve(source) for source in sources)


def _by_multigrid(matrix: Any, sources: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Solve by conjugate gradients with smoothed aggregation, to a residual relative to each source."""
    import pyamg
    from scipy.sparse.linalg import cg

    # The default coarse solver, a pseudo-inverse, loses conductances of 1e-12 of the largest.
    options = {"strength": _STRONG, "max_coarse": 500, "coarse_solver": "splu"}
    smoothed = pyamg.smoothed_aggregation_solver(matrix, **options).aspreconditioner()
    for source in sources:
        allowed = _RESIDUAL * float(np.abs(source).max())
        solution, failed = cg(matrix, source, rtol=0, atol=allowed, M=smoothed, maxiter=_MOST_ITERATIONS)
        if failed:
            raise ArithmeticError(
                f"the flow was not found in {_MOST_ITERATIONS} iterations; take fewer points"
            )
        yield np.asarray(solution)


def mean_under_fluid(levels: FloatArray, K: FloatArray, drops: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the means of K(p0 - P) over P from 0 to each drop, and their differences to twice the spacing.

    `levels` are P, an odd number of them, even from 0 to at least the largest drop; K falls with the load,
    nearly exponentially: its logarithm is interpolated, or K itself where it has zeros.
    """
    from scipy.interpolate import PchipInterpolator

    fine = np.linspace(0.0, levels[-1], 32 * (levels.size - 1) + 1)
    means = []
    for part in (slice(None), slice(None, None, 2)):
        if K[part].min() > 0:
            values = np.exp(PchipInterpolator(levels[part], np.log(K[part]))(fine))
        else:
            values = PchipInterpolator(levels[part], K[part])(fine)
        integral = PchipInterpolator(fine, values).antiderivative()
        means.append(integral(drops) / drops)
    return means[0], np.abs(means[1] - means[0])


def bruggeman(gap: FloatArray) -> float:
    """Estimate (K_xx K_yy)^(1/2) [length^3] of an isotropic gap by Bruggeman's effective medium."""
    # mean of n K/(g^3 + (n - 1) K) = 1 with n = 1/(1 - THRESHOLD); 0 from that contact area on.
    cubes, n = np.ravel(gap) ** 3, 1 / (1 - THRESHOLD)
    largest = float(cubes.max(initial=0.0))
    if largest == 0 or np.mean(cubes == 0) >= THRESHOLD:
        return 0.0
    cubes /= largest

    def excess(logarithm: float) -> float:
        K = math.exp(logarithm)
        return float(np.mean(n * K / (cubes + (n - 1) * K))) - 1

    # Near the threshold K falls below any bound: then it is zero to rounding.
    if excess(-690.0) >= 0:
        return 0.0
    return largest * math.exp(brentq(excess, -690.0, 0.0, xtol=1e-10))


FEWEST_POINTS = 6  # across a throat; below, K is only an estimate
ALLOWED = 0.01  # relative error of K by the solution of the contact


def doubts(axis: str, throat: Throat, depth: float, residual: float, points: Sequence[int]) -> Iterator[str]:
    """Yield why K along an axis is not to be trusted: a coarse throat, a contact solved too loosely.

    `points` are those of the grid.
    """
    # A residual r leaves gaps open by up to r times the deepest displacement `depth`; K changes as the cube
    # of the critical gap. Against contacts solved to 1e-10 this bound is two to three times the error.
    if throat.gap <= 0:
        return
    if throat.points < FEWEST_POINTS:
        yield (
            f"the throat along {axis} has {throat.points:.2g} points across it, below {FEWEST_POINTS}: the "
            "flow is right only to an order of magnitude; take more grid.points: "
            f"{finer(points, FEWEST_POINTS / max(throat.points, 1.0))}"
        )
    enough = ALLOWED * throat.gap / (3 * depth) if depth > 0 else math.inf
    if residual > enough:
        yield (
            f"the contact, solved to {residual:.1e}, changes the flow along {axis} by up to "
            f"{100 * ALLOWED * residual / enough:.2g} %; solver.tolerance: {enough:.1e} would do"
        )
