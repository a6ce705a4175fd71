"""Force, depth and contact radius of an isolated indentation over time; arrays in, arrays out.

`follow` chooses its steps to a tolerance. A fit of thousands of calls uses its parts. A `Space` depends
only on lengths: it serves all bodies that differ in their moduli. `on_steps` follows a history on given
times in some 30 us a step. `on_halved_steps` follows it also on half steps, which removes the error of
second order in the step, and `on_quartered_steps` also on quarters, which estimates the remaining error. With
space and times fixed the results are smooth functions of the moduli, the relaxation times and the history.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray, IntArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.network import relaxation
from gfmdlayer.history.time_points import SAME_TIME
from gfmdlayer.indentation.compliance import (
    Compliance,
    Features,
    compliance,
    elastic_limits,
    find_features,
    gauss_rule,
    panels,
)
from gfmdlayer.indentation.march import (
    COMPLETE,
    LEFT_GRID,
    Branches,
    EdgeLaw,
    MarchDrive,
    Marched,
    MarchNodes,
    march,
)
from gfmdlayer.kernels import announce, kernel
from gfmdlayer.observables.energy_balance import TOLERANCES
from gfmdlayer.punch.revolution import Revolution, abel_transform


class History(NamedTuple):
    """Prescribed depth or force, linear between the times; before the first time the body is at rest."""

    time: FloatArray  # (nt,), ascending
    value: FloatArray  # (nt,)
    by_force: bool | BoolArray = False  # of all times, or (nt,) of the pieces that end at them

    def by_force_at(self, time: FloatArray) -> BoolArray:
        """Whether a force is prescribed in the pieces that end at these times or later."""
        pieces = np.minimum(np.searchsorted(self.time, time), self.time.size - 1)
        return np.broadcast_to(self.by_force, self.time.shape)[pieces]


class Edge(NamedTuple):
    """Energies per area of a JKR edge, with the relaxed modulus 1/D of the surface's material.

    A receding edge takes chi(a)^2 D/(pi a) = work (1 + (v/speed)^exponent) at a speed v. An advancing edge
    gains u^2/(pi a D) = healing, with the jump u of the displacement. The body next to an edge is glassy,
    with J0 in place of D: there an edge takes work J0/D and gains healing D/J0, which is not more.
    """

    work: float = 0.0  # energy per area
    speed: float = math.inf  # length per time
    exponent: float = 1.0
    healing: float | None = None  # energy per area; None: as much as the edge takes

    def law(self, body: Compliance) -> EdgeLaw:
        """Return the energy release rates with J0; ValueError if the healing is too large."""
        ratio = body.local / (body.local + float(body.local_modes.sum()))
        most = self.work * ratio**2
        healing = most if self.healing is None else self.healing
        if healing > most * (1 + 1e-9):
            raise ValueError(
                f"healing_work: got {healing:.6g}; must be <= {most:.6g}, work times the square "
                "of the surface's relaxed over its glassy modulus: cycles would gain energy"
            )
        # Whole numbers would compile the kernels once more.
        return EdgeLaw(self.work * ratio, healing / ratio, float(self.speed), float(self.exponent))


NO_ADHESION = Edge()


# Residual at the edge of the contact, relative to the depth, at which a radius is accepted.
_EDGE = 1e-13

# The same of fits with adhesion.
_ROUGH_EDGE = 1e-10

# Change of the rate, relative to the largest, from which a time of the history is a breakpoint.
_JUMP = 1e-3

# Largest ratio of the lengths of two steps through which a parabola leads.
_UNEVEN = 16.0

# Wavenumber, times the contact radius, at which the body responds like its surface's material.
_FAR = 1e8

# Largest contact radius, times the last wavenumber at which layers matter: the cosines of the nodes then take
# 2 GB, and a contact is some 300 times as wide as the layer is thick.
_MOST_PHASE = 4000.0

# A contact radius smaller than any, and the bisections from it to any other.
_TINY, _MOST_ITERATIONS = 1e-40, 400

# Reach of the nodes: over the largest contact of the elastic limits; for these limits, over the contact on
# a halfspace; and growth of a reach that failed.
_MARGIN, _WIDER, _LARGER = 1.06, 1.5, 1.5


class LeftGridError(ArithmeticError):
    """The contact grew beyond the radius for which the nodes are made."""


class Space(NamedTuple):
    """Nodes in q and x for contacts up to a radius on bodies of the same lengths."""

    features: Features
    q: FloatArray
    weights: FloatArray
    nodes: MarchNodes

    def compliance(self, body: Body) -> Compliance:
        """Return the compliance of a body at these nodes."""
        return compliance(body, self.features, self.q, self.weights)


def make_space(features: Features, reach: float, tolerance: float = 1e-4) -> Space:
    """Return the nodes for contacts up to the radius `reach`, to a relative error of the force.

    Raises ValueError if the contact is too large compared with the layers.
    """
    phase = features.last * reach
    if phase > 1.001 * _MOST_PHASE:
        raise ValueError(
            f"a contact of radius {reach:.6g} is too large for the thinnest layer: beyond a radius of "
            f"{_MOST_PHASE / features.last:.3g} it takes gigabytes; must be less"
        )
    fineness = max(1.0, math.sqrt(1e-4 / tolerance))
    q, weights = panels(features, reach)
    n = int(max(160 * fineness, 4 * phase * math.sqrt(fineness))) + 1
    gauss = 16 + math.ceil(phase / 3)
    spacing = reach / (n - 1)
    x, w = gauss_rule(gauss)
    y, v = gauss_rule(max(8, gauss // 2))
    cosines = np.cos(np.outer(np.arange(2 * n + 3) * spacing, q))
    nodes = MarchNodes(reach, spacing, cosines, (x + 1) / 2, w / 2, (y + 1) / 2, v / 2)
    return Space(features, q, weights, nodes)


def find_space(
    body: Body, profile: Revolution, history: History, tolerance: float = 1e-4, adhesion: Edge = NO_ADHESION
) -> Space:
    """Return the nodes for the largest contact of a history, found from the glassy and the relaxed body.

    Raises ValueError if the body does not support an isolated load or the contact is too large compared with
    its layers, and ArithmeticError if no contact radius is found.
    """
    if math.isfinite(profile.rim) and abel_transform(profile, profile.rim) == 0:
        return make_space(find_features(body, profile.rim), profile.rim, tolerance)
    largest = max(float(history.value.max()), 0.0)
    if largest == 0:  # nothing touches, whatever the nodes
        return make_space(Features(1.0, 0.0, 0.0), 1.0, tolerance)
    by_force = bool(np.any(history.by_force))
    reach = min(_WIDER * _halfspace_radius(body, profile, largest, by_force, adhesion.work), profile.rim)
    features = find_features(body, reach)
    if features.last * reach > _MOST_PHASE:  # on a soft base the contact may be smaller
        reach = _MOST_PHASE / features.last
    ends = History(np.array([0.0, 1.0]), np.array([0.0, largest]), by_force)
    for _ in range(60):
        space = make_space(features, reach)
        healing = Edge(adhesion.law(space.compliance(body)).healing)  # of either elastic limit
        try:
            limits = [
                march_on(elastic, space, profile, ends, ends.time, healing)
                for elastic in _elastic_limits(body, space)
            ]
        except LeftGridError:
            reach = _LARGER * reach
            continue
        radius = max(limit.radius[-1] for limit in limits)
        return make_space(features, min(_MARGIN * max(radius, 0.02 * reach), profile.rim), tolerance)
    raise ArithmeticError(f"no contact radius found for the largest value of the history, {largest:.6g}")


def march_on(
    body: Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    adhesion: Edge = NO_ADHESION,
    snapshots: FloatArray | None = None,
    located: float = 1.0,
) -> Marched:
    """Follow a history on given steps, see `on_steps`."""
    value = np.interp(time, history.time, history.value)
    breakpoints = np.isin(time, breakpoints_of(history))
    kept = np.isin(time, [] if snapshots is None else snapshots)
    accuracy = _EDGE if located == 1 else _ROUGH_EDGE
    by_force, law = history.by_force_at(time), adhesion.law(body)
    drive = MarchDrive(time, value, by_force, breakpoints, kept, law, located, accuracy)
    announce(march, 50)
    marched = march(body, _branches(body), profile, space.nodes, drive)
    if marched.status == COMPLETE:
        return marched
    when = f"t = {time[marched.stopped]:.6g}"
    if marched.status == LEFT_GRID:
        raise LeftGridError(f"{when}: the contact grows beyond the radius {space.nodes.reach:.6g}")
    raise ArithmeticError(f"{when}: no contact radius found")


def _branches(body: Compliance) -> Branches:
    """Return the modulus of the surface's material.

    With the modes of D and of G = 1/D, D/(1 + s t) = sum_k [J_k T_k/(T_k - t)]/(1 + s T_k) for a time t of G,
    where D(-1/t) = 0; and the way back likewise.
    """
    J, T = body.local_modes, body.local_times
    moduli, times = relaxation(body.local, J, T)
    apart = T[:, np.newaxis] - times
    of_retarded = np.ascontiguousarray((J * T) / apart.T)  # one layout, one compilation
    return Branches(1 / body.local, moduli, times, of_retarded, moduli * times / apart)


def breakpoints_of(history: History) -> FloatArray:
    """Return the times between the first and the last at which the rate of a history jumps."""
    rate = np.diff(history.value) / np.diff(history.time)
    by_force = np.broadcast_to(history.by_force, history.time.shape)
    switch = by_force[1:] != by_force[:-1]
    rate[switch] = 0.0
    largest = np.zeros(rate.size)
    for is_by_force in (True, False):
        steps = by_force[1:] == is_by_force
        largest[steps] = np.abs(rate[steps]).max(initial=1e-300)
    jumps = np.abs(np.diff(rate)) > _JUMP * np.maximum(largest[1:], largest[:-1] * ~switch[1:])
    return np.asarray(history.time[1:-1][jumps | switch[1:]])


def _elastic_limits(body: Body, space: Space) -> Iterator[Compliance]:
    """Yield the elastic bodies for sudden and for slow loads."""
    none, nothing = np.zeros(0), np.zeros((0, space.q.size))
    for q_K in elastic_limits(body, np.append(space.q, space.features.surface)):
        local = float(q_K[-1])
        yield Compliance(local, none, none, space.q, space.weights, q_K[:-1] - local, nothing, nothing)


def _halfspace_radius(
    body: Body, profile: Revolution, largest: float, by_force: bool, adhesion: float
) -> float:
    """Contact radius on a halfspace of the surface's relaxed material, for the largest depth or force."""
    radius, D = 1.0, 0.0
    for _ in range(3):  # the wavenumber of the surface's material depends on the radius
        far, last = _FAR / radius, D
        D = far / float(body.stiffness(np.array([far]), 0.0)[0])
        if last == D:
            break
        radius = halfspace_radius(profile, D, largest, by_force, adhesion)
    return radius


@kernel
def halfspace_radius(profile: Revolution, D: float, largest: float, by_force: bool, adhesion: float) -> float:
    """Contact radius on an elastic halfspace of D = (1 - nu)/G, within 0.1 %, for a depth or a force.

    It is the rim of an indenter that is pressed in as a whole.
    """
    low, high, found = 0.0, min(_TINY, profile.rim), False
    for _ in range(_MOST_ITERATIONS):
        a = 0.5 * (low + high) if found else high
        reached = abel_transform(profile, a) - math.sqrt(math.pi * a * adhesion * D)
        if by_force:  # F = (4/D) int_0^a (depth - H) dx, by the midpoint rule, for an estimate
            for i in range(32):
                reached -= abel_transform(profile, a * (i + 0.5) / 32) / 32
            reached *= 4 * a / D
        if reached < largest:
            low = a
            if not found:
                if a >= profile.rim:
                    break
                high = min(2 * a, profile.rim)
        else:
            high, found = a, True
            if high - low < 1e-3 * high:
                break
    return high


def graded_steps(knots: FloatArray, shortest: float) -> FloatArray:
    """Steps that grow from each knot on, from a part of the shortest time to an eighth of the way."""
    pieces = [knots[:1]]
    for begin, end in pairwise(knots.tolist()):
        largest, at = (end - begin) / 8, 0.0
        step = min(largest, 0.3 * shortest)
        ends = []
        while at + step < end - begin:
            at += step
            ends.append(at)
            step = min(1.5 * step, largest)
        stretch = 1.0 if not ends else (end - begin) / (at + step)
        pieces.append(np.append(begin + stretch * np.array(ends), end))
    return np.concatenate(pieces)


def even_steps(run: Indentation, knots: FloatArray, spread: float) -> FloatArray:
    """Times, the knots among them, between which linear interpolation has the same error (de Boor).

    The force, depth and radius of `run` bend as the wanted ones. `spread` is the square root of eight times
    the error, relative to the largest value.
    """
    t = run.time
    density = np.zeros(t.size - 1)
    for values in (run.force, run.depth, run.radius):
        largest = np.abs(values).max()
        if not largest > 0:
            continue
        slope = np.diff(values) / np.diff(t)
        bend = np.abs(np.diff(slope)) / (0.5 * (t[2:] - t[:-2]))
        bend[np.isin(t[1:-1], knots)] = 0.0
        bend = np.concatenate((bend[:1], bend, bend[-1:]))
        density = np.maximum(density, np.sqrt(np.maximum(bend[1:], bend[:-1]) / largest))
    pieces = []
    for begin, end in pairwise(knots.tolist()):
        inside = (t[:-1] >= begin) & (t[:-1] < end)
        lengths, own = np.diff(t)[inside], density[inside]
        # A jump of the slope of the force, where contact is lost, must not attract all the times.
        total = (own * lengths).sum()
        own = np.minimum(own, 8 * total / (end - begin)) + (0.2 * total + 3 * spread) / (end - begin)
        level = np.concatenate(([0.0], np.cumsum(own * lengths)))
        count = max(1, math.ceil(level[-1] / spread))
        edges = np.append(t[:-1][inside], end)
        pieces.append(np.interp(np.linspace(0, level[-1], count + 1)[:-1], level, edges))
        pieces[-1][0] = begin
    return np.append(np.concatenate(pieces), knots[-1])


def corners(t: FloatArray, values: FloatArray, within: float | FloatArray) -> list[int]:
    """Return the rows between which values are linear in t, within distances, by Douglas and Peucker."""
    within = np.broadcast_to(within, values.shape)
    kept, stack = {0, t.size - 1}, [(0, t.size - 1)]
    while stack:
        i, j = stack.pop()
        if j - i < 2:
            continue
        line = values[i] + (values[j] - values[i]) * (t[i + 1 : j] - t[i]) / (t[j] - t[i])
        away = np.abs(values[i + 1 : j] - line) / within[i + 1 : j]
        k = i + 1 + int(away.argmax())
        if away[k - i - 1] > 1:
            kept.add(k)
            stack += [(i, k), (k, j)]
    return sorted(kept)


# Order of the extrapolated results in the step: 4 for a smooth motion of the edge, less where it turns or
# starts; measured, 2.4 to 3. Between, where the gain of the extrapolation is interpolated, the first steps
# have the order 4/3: the radius grows like the third root of a force.
_ORDER, _ORDER_BETWEEN = 2.0, 4 / 3

# New steps: part of the tolerance to reach; power of the step in the growth of the error; least and largest
# number of them in place of one.
_SAFE, _GROWTH_ORDER, _LEAST_PARTS, _MOST_PARTS = 0.8, 4.0, 0.5, 3.0
_FALLS = 0.7  # part to which the residual of the energies must fall from mesh to mesh, for another one
_PARTS_OF_JUMP = 8.0  # of a step in which contact with adhesion begins or is lost
_BEFORE_JUMPS = 0.1  # part of `everywhere` with adhesion: the largest errors are those of the place of a jump

# Spread of `even_steps` for the first mesh, over the root of the tolerance; measured, mostly enough.
_FIRST_SPREAD = 45.0

# Deviation of a straight line between two rows, relative to the largest value.
_STRAIGHT = 1e-3
_OF_POWER = 4 / 27  # part of its change, of a power 2/3 or 3/2

# Part of the largest radius below which the error of its square counts.
_SMALL = 0.1

_MOST_MESHES, _MOST_STEPS, _MOST_SPACES, _GROWTH = 16, 10_000, 12, 1.3


class Indentation(NamedTuple):
    """Columns of an indentation, each of shape (nt,)."""

    time: FloatArray
    force: FloatArray
    depth: FloatArray
    radius: FloatArray  # 0 without contact
    stored: FloatArray
    dissipated: FloatArray
    parted: FloatArray  # energy that the edge has taken, less that of healing
    rise: FloatArray  # 0 where pressure and gap are surely not negative, see `march.Marched`
    error: float  # largest estimated error of force, depth and radius, relative to their largest; or NaN
    solutions: int  # solved integral equations
    fields: Marched | None = None  # with the fields at the snapshots
    space: Space | None = None
    lost: FloatArray | None = None  # (losses, 2), times and forces before it, if they are located


def on_steps(
    body: Body | Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    adhesion: Edge = NO_ADHESION,
    snapshots: FloatArray | None = None,
    located: float = 1.0,
) -> Indentation:
    """Follow a history on given times: the ends of the steps, among them its breakpoints and snapshots.

    The body may be given by its compliance at the nodes of the space. Raises
    LeftGridError if the contact grows beyond the space, ArithmeticError if a contact radius is not found.
    """
    made = body if isinstance(body, Compliance) else space.compliance(body)
    marched = march_on(made, space, profile, history, time, adhesion, snapshots, located)
    at = np.flatnonzero(np.isfinite(marched.lost))
    return Indentation(
        time, marched.force, marched.depth, marched.radius, marched.stored, marched.dissipated,
        marched.parted, marched.rise, math.nan, marched.solutions, marched, space,
        np.column_stack((marched.lost[at], marched.last_force[at])),
    )  # fmt: skip


def on_halved_steps(
    body: Body | Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    snapshots: FloatArray | None = None,
    adhesion: Edge = NO_ADHESION,
    located: float = 1.0,
) -> Indentation:
    """Follow a history on given times and their middles, without the error of second order in the step.

    For the arguments see `on_steps`. The result has 2 nt - 1 times, and no estimate of its error.
    """
    made = body if isinstance(body, Compliance) else space.compliance(body)
    coarse = on_steps(made, space, profile, history, time, adhesion, None, located)
    fine = on_steps(made, space, profile, history, halved(time), adhesion, snapshots, located)
    result = _extrapolated(coarse, fine, history, adhesion)
    whole, half = coarse.lost, fine.lost
    if whole is not None and half is not None and whole.shape == half.shape:
        half = half.copy()
        half[:, 0] += (half[:, 0] - whole[:, 0]) / 3
    return result._replace(lost=half)


def on_quartered_steps(
    body: Body | Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    snapshots: FloatArray | None = None,
    adhesion: Edge = NO_ADHESION,
    shift: float = 0.0,
) -> tuple[Indentation, FloatArray]:
    """Follow a history on the quarters of given steps, like `on_halved_steps`, with an estimate of its error.

    The result has 4 nt - 3 times. The estimates of force, depth and radius, relative to the largest of each,
    have the shape (3, 2 nt - 1): they belong to the times of half steps. Errors that a shift in time removes
    do not count, since a contact with adhesion jumps.
    """
    made = body if isinstance(body, Compliance) else space.compliance(body)
    whole, half = (on_steps(made, space, profile, history, each, adhesion) for each in (time, halved(time)))
    quarter = on_steps(made, space, profile, history, halved(half.time), adhesion, snapshots)
    rough = _extrapolated(whole, half, history, adhesion)
    fine = _extrapolated(half, quarter, history, adhesion)
    # Where contact is lost the radius falls like a root of time: then the error of its square counts.
    small = _SMALL * fine.radius.max() + 1e-300
    share = np.minimum(1.0, np.minimum(rough.radius, fine.radius[::2]) / small)
    errors = np.zeros((3, rough.time.size))
    for row, name in zip(errors, ("force", "depth", "radius"), strict=True):
        values, other = getattr(fine, name), getattr(rough, name)
        apart = _apart(fine.time, values, other, shift) if shift else values[::2] - other
        row[:] = apart / max(float(np.abs(values).max()), 1e-300)
    errors[2] *= share
    errors[:, ::2] /= 2**_ORDER - 1
    errors[:, 1::2] /= 2**_ORDER_BETWEEN - 1
    solutions = whole.solutions + half.solutions + quarter.solutions
    return fine._replace(error=float(np.abs(errors).max()), solutions=solutions), errors


def _apart(time: FloatArray, fine: FloatArray, rough: FloatArray, shift: float) -> FloatArray:
    """Distance of a curve at every other time from another one that may be shifted in time."""
    at = time[::2]
    inside = time.searchsorted(at - shift), time.searchsorted(at + shift, "right")
    ends = np.transpose([np.interp(each, time, fine) for each in (at - shift, at, at + shift)])
    parts = [np.append(fine[i:j], each) for i, j, each in zip(*inside, ends, strict=True)]
    low, high = np.array([(part.min(), part.max()) for part in parts]).T
    return np.asarray(np.maximum(low - rough, 0.0) + np.minimum(high - rough, 0.0))


def jumps(run: Indentation, shift: float) -> IntArray:
    """Steps of a run above the shift in which contact begins or is lost."""
    touching = run.radius > 0
    return np.flatnonzero((touching[1:] != touching[:-1]) & (np.diff(run.time) > shift))


def _beside_the_pull(run: Indentation, tolerance: float) -> IntArray:
    """The two steps at the row of the largest pull, if the force bends there by more than the tolerance."""
    at = int(run.force.argmin())
    near = slice(max(at - 1, 0), at + 2)
    if run.force[at] >= 0 or not run.radius[near].all() or run.force[near].size < 3:
        return np.zeros(0, dtype=int)
    # Between equal steps a parabola is at most an eighth of its second difference below its least row.
    bend = float(np.diff(run.force[near], 2)[0]) / 8
    return np.array([at - 1, at] if bend > tolerance * np.abs(run.force).max() else [], dtype=int)


def halved(time: FloatArray) -> FloatArray:
    """Times and their middles."""
    both = np.empty(2 * time.size - 1)
    both[::2], both[1::2] = time, (time[1:] + time[:-1]) / 2
    return both


def _extrapolated(coarse: Indentation, fine: Indentation, history: History, adhesion: Edge) -> Indentation:
    """Return a run on halved steps without its error of second order, by the run on the steps.

    The gain is known where both runs touch, or both do not; between these times it is a parabola, beside much
    shorter steps a line, and beyond them constant. For the runs lose contact at other times. The square of
    the radius is extrapolated: where contact is lost the radius falls like a root of time.
    """
    t, steps, breaks = coarse.time, np.diff(coarse.time), np.isin(coarse.time, breakpoints_of(history))
    even = np.maximum(steps[1:], steps[:-1]) <= _UNEVEN * np.minimum(steps[1:], steps[:-1])
    cases = []
    for touching in (True, False):
        rows = ((fine.radius[::2] > 0) == touching) & ((coarse.radius > 0) == touching)
        if rows.any():
            rows[:-1] |= rows[1:] & (fine.radius[:-2:2] == coarse.radius[:-1])  # where contact begins
            smooth = rows[:-2] & rows[1:-1] & rows[2:] & ~breaks[1:-1] & even
            cases.append(((fine.radius > 0) == touching, rows, smooth))

    def better(of_fine: FloatArray, of_coarse: FloatArray) -> FloatArray:
        """Return the extrapolated values."""
        values = of_fine.copy()
        for at, rows, smooth in cases:
            known = np.interp(t, t[rows], ((of_fine[::2] - of_coarse) / 3)[rows])
            gain = halved(known)
            gain[1::2] -= _bends(t, known, smooth) * np.diff(t) ** 2 / 4
            values[at] += gain[at]
        return values

    reach = math.inf if fine.space is None else fine.space.nodes.reach  # at most the rim of the indenter
    return fine._replace(
        force=np.maximum(better(fine.force, coarse.force), -math.inf if adhesion.work else 0.0),
        depth=better(fine.depth, coarse.depth),
        radius=np.minimum(np.sqrt(np.maximum(better(fine.radius**2, coarse.radius**2), 0.0)), reach),
        stored=better(fine.stored, coarse.stored),
        dissipated=better(fine.dissipated, coarse.dissipated),
        parted=better(fine.parted, coarse.parted),
        solutions=fine.solutions + coarse.solutions,
    )


def _bends(x: FloatArray, y: FloatArray, smooth: BoolArray) -> FloatArray:
    """Second divided differences in the intervals, as the mean of those at the ends that are smooth."""
    slope = np.divide(np.diff(y), np.diff(x), out=np.zeros(y.size - 1), where=np.diff(x) != 0)
    bend = np.diff(slope) / np.where(smooth, x[2:] - x[:-2], 1.0) * smooth
    total, number = np.zeros(slope.size), np.zeros(slope.size)
    for part in (slice(None, -1), slice(1, None)):
        total[part] += bend
        number[part] += smooth
    return total / np.maximum(number, 1)


def follow(
    body: Body,
    profile: Revolution,
    history: History,
    *,
    tolerance: float = 1e-4,
    adhesion: Edge = NO_ADHESION,
    stops: Sequence[float] = (),
    snapshots: Sequence[float] | FloatArray = (),
    space: Space | None = None,
) -> Indentation:
    """Follow a history on steps chosen for a tolerance, on nodes from `find_space` unless they are given.

    The tolerance is the error of force, depth and contact radius, relative to the largest of each; `error` of
    the result is above it if it was not reached. Steps land on `stops` and `snapshots`; fields are kept at
    the snapshots. Raises ValueError if the body does not support an isolated load, ArithmeticError if a
    contact radius is not found.
    """
    space = space or find_space(body, profile, history, tolerance, adhesion)
    kept = distinct(snapshots, history.time)
    within = 0.1 * tolerance * float(np.abs(history.value).max())
    turns = np.union1d(history.time[corners(history.time, history.value, within)], kept)
    knots = np.union1d(turns, distinct(stops, turns))
    return in_growing_space(
        lambda space: _to_tolerance(
            space.compliance(body), space, profile, history, (turns, knots, kept), tolerance, adhesion
        ),
        space,
        profile,
        tolerance,
    )


def distinct(asked: Sequence[float] | FloatArray, times: FloatArray) -> FloatArray:
    """Ascending times; those equal to one of the given times but for rounding, as 3 * 0.1, are that one."""
    landings: FloatArray = np.array(asked, dtype=float)
    same = SAME_TIME * max(float(np.abs(each).max(initial=0.0)) for each in (landings, times))
    for near in (times.searchsorted(landings).clip(max=times.size - 1) - values for values in (0, 1)):
        other = times[near]
        landings = np.where(np.abs(landings - other) <= same, other, landings)
    landings = np.unique(landings)
    apart = np.diff(landings) > same
    return np.asarray(landings[np.append(True, apart)[: landings.size]])


def in_growing_space(
    attempt: Callable[[Space], Indentation], space: Space, profile: Revolution, tolerance: float
) -> Indentation:
    """Return the result of an attempt, with nodes for larger contacts if a contact grew beyond the space.

    Raises ArithmeticError if the contact grows without bound.
    """
    for _ in range(_MOST_SPACES):
        try:
            return attempt(space)._replace(space=space)
        except LeftGridError:
            space = make_space(space.features, min(_GROWTH * space.nodes.reach, profile.rim), tolerance)
    raise ArithmeticError("the contact grows without bound")


def _to_tolerance(
    body: Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    landing: tuple[FloatArray, FloatArray, FloatArray],
    tolerance: float,
    adhesion: Edge,
) -> Indentation:
    """Choose steps by a coarse run, and refine them until the estimated error is within the tolerance.

    Steps grade at the times in `turns`, land on those in `knots`, and keep their fields at those in `kept`.
    """
    turns, knots, kept = landing
    shortest = min(
        (float(each.min()) for each in (body.local_times, body.times) if each.size), default=math.inf
    )
    first = on_steps(body, space, profile, history, graded_steps(turns, shortest), adhesion)
    if math.isinf(shortest) and math.isinf(adhesion.speed):
        time = _landing(even_steps(first, turns, 0.1), knots)
        shift = tolerance * float(knots[-1] - knots[0]) if adhesion.work else math.inf
        for _ in range(_MOST_MESHES):
            # Each step is exact: only a jump and the largest pull depend on their steps.
            result = on_steps(body, space, profile, history, time, adhesion, kept)
            coarse = np.append(jumps(result, shift), _beside_the_pull(result, tolerance))
            parts = _parts_of_curve(result, turns, adhesion)
            if not coarse.size and parts.max() <= 1:
                return result._replace(error=0.0)
            parts[coarse] = _PARTS_OF_JUMP
            time = _refined(time, parts, knots)
        return result._replace(error=math.inf)
    time = _landing(even_steps(first, turns, _FIRST_SPREAD * tolerance ** (1 / _ORDER)), knots)
    solutions, shift = 0, tolerance * float(knots[-1] - knots[0]) if adhesion.work else 0.0
    room = math.inf
    for mesh in range(_MOST_MESHES):
        result, errors = on_quartered_steps(body, space, profile, history, time, kept, adhesion, shift)
        solutions += result.solutions
        coarse = jumps(result, shift) if shift else np.zeros(0, dtype=int)
        drawn = _parts_of_curve(result, turns, adhesion).reshape(-1, 4).max(axis=1)
        if result.time.size > _MOST_STEPS:
            break
        if result.error <= tolerance and not coarse.size:
            left_open = _left_open(result, adhesion)[::2]
            if not tolerance < np.abs(left_open).max() < room:
                if drawn.max() <= 1:
                    break
                time = _refined(time, drawn, knots)
                continue
            errors, room = np.vstack((errors, left_open)), _FALLS * np.abs(left_open).max()
        everywhere = (mesh + 1) / _MOST_MESHES * (_BEFORE_JUMPS if shift else 1.0)
        parts = _parts(result.radius[::4], errors, everywhere, tolerance)
        parts[coarse // 4] = _PARTS_OF_JUMP
        time = _refined(time, np.maximum(parts, drawn) if mesh else parts, knots)
    late = float(np.diff(result.time)[coarse].max(initial=0.0) / (knots[-1] - knots[0]))
    return result._replace(solutions=solutions, error=max(result.error, late))


def _left_open(run: Indentation, adhesion: Edge) -> FloatArray:
    """Return the residual of the energy balance relative to the largest energy, and to its limit.

    With adhesion it is zero: jumps lose energy.
    """
    energies, work = run.stored + run.dissipated, work_of(run)
    scale = max(float(np.abs(each).max()) for each in (work, energies))
    if adhesion.work or not scale:
        return np.zeros(run.time.size)
    return np.asarray((work - energies) / (TOLERANCES * scale))


def _parts(radius: FloatArray, errors: FloatArray, everywhere: float, tolerance: float) -> FloatArray:
    """Number of steps in place of each, so that the error grows equally, in all by less than the tolerance.

    The growth of the error in a step is taken as a power of its length. Steps of large growth share the part
    of the whole growth that the tolerance leaves. An error may show later than it arises: where the edge
    passes a radius again, and, for the part `everywhere` of the growth, anywhere.
    """
    growth = np.abs(np.diff(errors)).max(axis=0)
    growth = growth[::2] + growth[1::2] + 1e-300
    growth += np.bincount(_passed_before(radius), growth, minlength=growth.size)
    growth += everywhere * (growth.mean() - growth)
    whole, wanted = growth.sum(), _SAFE * tolerance / (np.abs(errors).max() + 1e-300)
    levels = np.sort(growth)
    below = np.cumsum(levels) + levels * np.arange(levels.size - 1, -1, -1)
    level = float(np.interp(wanted * whole, below, levels, left=wanted * whole / levels.size))
    return np.asarray(np.clip((growth / level) ** (1 / _GROWTH_ORDER), _LEAST_PARTS, _MOST_PARTS))


def _refined(time: FloatArray, parts: FloatArray, knots: FloatArray) -> FloatArray:
    """Times with so many steps in place of each; the knots are among them."""
    count = np.concatenate(([0.0], np.cumsum(parts)))
    at = np.interp(knots, time, count)
    pieces = []
    for knot, (begin, end) in zip(knots, pairwise(at.tolist()), strict=False):
        steps = max(1, math.ceil(end - begin - 1e-9))
        pieces.append(np.interp(np.linspace(begin, end, steps + 1)[:-1], count, time))
        pieces[-1][0] = knot
    return np.append(np.concatenate(pieces), knots[-1])


def _landing(time: FloatArray, knots: FloatArray) -> FloatArray:
    """Times about as dense as these, the knots among them."""
    return _refined(time, np.ones(time.size - 1), knots)


def _parts_of_curve(run: Indentation, turns: FloatArray, adhesion: Edge) -> FloatArray:
    """Number of steps in place of each, from 1, so that straight lines between the rows follow the curves.

    The force, the depth and the square of the radius, which is linear where contact begins, deviate from the
    straight line over a step by an eighth of their second derivative times the square of the step; by that of
    the neighbours, but for those behind a turn of the history, or the beginning or the end of contact. There
    force and depth without adhesion are powers 2/3 or 3/2, at most 4/27 of their change off the line.
    """
    t, touching = run.time, run.radius > 0
    steps = np.diff(t)
    passed = steps > 0  # those of a jump end at times that are equal but for rounding
    smooth = (touching[2:] == touching[:-2]) & ~np.isin(t[1:-1], turns) & passed[1:] & passed[:-1]
    both = np.where(smooth, t[2:] - t[:-2], 1.0)
    off = np.zeros(steps.size)
    for values, power in ((run.force, _OF_POWER), (run.depth, _OF_POWER), (run.radius**2, 0.0)):
        scale = max(float(np.abs(values).max()), 1e-300)
        slope = np.divide(np.diff(values), steps, out=np.zeros(steps.size), where=passed)
        bend = np.abs(np.diff(slope)) / both * smooth / scale
        bend = np.maximum(np.append(bend, 0.0), np.append(0.0, bend))
        np.maximum(off, bend * steps**2 / 4, out=off)
        if not adhesion.work:
            rim = (touching[1:] != touching[:-1]) * np.abs(np.diff(values)) / scale
            np.maximum(off, power * rim, out=off)
    return np.asarray(np.clip(np.sqrt(off / _STRAIGHT), 1.0, _MOST_PARTS))


def _passed_before(radius: FloatArray) -> IntArray:
    """Number of the latest step before each in which the edge passed the same radius; its own without one."""
    low, high = np.minimum(radius[1:], radius[:-1]), np.maximum(radius[1:], radius[:-1])
    middle = ((low + high) / 2)[:, np.newaxis]
    steps = np.arange(low.size)
    before = np.tril((low < middle) & (middle < high), -1)
    return np.where(before.any(axis=1), steps.size - 1 - before[:, ::-1].argmax(axis=1), steps)


def work_of(run: Indentation) -> FloatArray:
    """Work of the indenter, shape (nt,); what an elastic body stores, as no path to a contact enters it."""
    if not (run.dissipated.any() or run.parted.any()):
        return run.stored
    return work_done(run.force, run.depth, float(run.stored[0] + run.dissipated[0]))


def work_done(force: FloatArray, depth: FloatArray, start: float) -> FloatArray:
    """Integral of the force over the depth along a curve, from the work `start` at its first point.

    Between two points it is the mean over the parabolas through their neighbours on either side, where the
    depth goes on in the same direction; elsewhere the trapezoidal rule.
    """
    if force.size < 2:
        return np.full(force.size, start)
    width = np.diff(depth)
    bend = _bends(depth, force, width[1:] * width[:-1] > 0)
    areas = width * (force[1:] + force[:-1]) / 2 - bend * width**3 / 6
    return start + np.concatenate(([0.0], np.cumsum(areas)))
