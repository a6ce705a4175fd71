"""Nodes in q and x for the largest contact of a history."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.indentation.compliance import (
    Compliance,
    Features,
    compliance,
    elastic_limits,
    find_features,
    gauss_rule,
    panels,
)
from gfmdlayer.indentation.march import COMPLETE, LEFT_GRID, Drive, Marched, Nodes, march
from gfmdlayer.kernels import kernel
from gfmdlayer.punch.revolution import Revolution, abel_transform


class History(NamedTuple):
    """Prescribed depth or force, linear between the times; before the first time the body is at rest."""

    time: FloatArray  # (nt,), ascending
    value: FloatArray  # (nt,)
    by_force: bool = False


# Residual at the edge of the contact, relative to the depth, at which a radius is accepted.
_EDGE = 1e-10

# Change of the rate, relative to the largest, from which a time of the history is a breakpoint.
_JUMP = 1e-3

# Wavenumber, times the contact radius, at which the body responds like its surface's material.
_FAR = 1e8

# Largest contact radius, times the last wavenumber at which layers matter: the cosines of the nodes then take
# 2 GB, and a contact is some 300 times as wide as the layer is thick.
_MOST_PHASE = 4000.0

# A contact radius smaller than any, and the bisections from it to any other.
_TINY, _MOST_ITERATIONS = 1e-40, 400

# Reach of the nodes: over the largest contact of the elastic limits; for these limits, over the contact on
# a halfspace; and growth of a reach that failed.
_MARGIN, _WIDER, _GROWTH = 1.06, 1.5, 1.5


class LeftGridError(ArithmeticError):
    """The contact grew beyond the radius for which the nodes are made."""


class Space(NamedTuple):
    """Nodes in q and x for contacts up to a radius on bodies of the same lengths."""

    features: Features
    q: FloatArray
    weights: FloatArray
    nodes: Nodes

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
    nodes = Nodes(reach, spacing, cosines, (x + 1) / 2, w / 2, (y + 1) / 2, v / 2)
    return Space(features, q, weights, nodes)


def find_space(
    body: Body, profile: Revolution, history: History, tolerance: float = 1e-4, adhesion: float = 0.0
) -> Space:
    """Return the nodes for the largest contact of a history, found from the glassy and the relaxed body.

    Raises ValueError if the body does not support an isolated load or the contact is too large compared with
    its layers, and ArithmeticError if no contact radius is found.
    """
    if math.isfinite(profile.rim) and abel_transform(profile, profile.rim) == 0:
        return make_space(find_features(body, profile.rim), profile.rim, tolerance)
    largest = max(float(history.value.max()), 0.0)
    if largest == 0 == adhesion:  # nothing touches, whatever the nodes
        return make_space(Features(1.0, 0.0, 0.0), 1.0, tolerance)
    reach = min(_WIDER * _halfspace_radius(body, profile, largest, history.by_force, adhesion), profile.rim)
    features = find_features(body, reach)
    if features.last * reach > _MOST_PHASE:  # on a soft base the contact may be smaller
        reach = _MOST_PHASE / features.last
    ends = History(np.array([0.0, 1.0]), np.array([0.0, largest]), history.by_force)
    for _ in range(60):
        space = make_space(features, reach)
        try:
            limits = [
                march_on(each, space, profile, ends, ends.time, adhesion)
                for each in _elastic_limits(body, space)
            ]
        except LeftGridError:
            reach = _GROWTH * reach
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
    adhesion: float = 0.0,
    snapshots: FloatArray | None = None,
) -> Marched:
    """Follow a history on given steps, see `solve.on_steps`."""
    value = np.interp(time, history.time, history.value)
    breakpoints = np.isin(time, breakpoints_of(history))
    kept = np.isin(time, [] if snapshots is None else snapshots)
    drive = Drive(time, value, history.by_force, breakpoints, kept, adhesion, _EDGE)
    found = march(body, profile, space.nodes, drive)
    if found.status == COMPLETE:
        return found
    when = f"t = {time[found.stopped]:.6g}"
    if found.status == LEFT_GRID:
        raise LeftGridError(f"{when}: the contact grows beyond the radius {space.nodes.reach:.6g}")
    raise ArithmeticError(f"{when}: no contact radius found")


def breakpoints_of(history: History) -> FloatArray:
    """Return the times between the first and the last at which the rate of a history jumps."""
    rate = np.diff(history.value) / np.diff(history.time)
    jumps = np.abs(np.diff(rate)) > _JUMP * max(float(np.abs(rate).max()), 1e-300)
    return np.asarray(history.time[1:-1][jumps])


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
