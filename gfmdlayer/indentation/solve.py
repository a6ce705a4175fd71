"""Force, depth and contact radius of an isolated indentation over time; arrays in, arrays out.

`follow` chooses its steps to a tolerance. A fit of thousands of calls uses its parts. A `Space` depends only
on lengths: it serves all bodies that differ in their moduli. `on_steps` follows a history on given times in
some 30 us a step. `on_halved_steps` follows it also on half steps, which removes the error of second order in
the step and estimates it. With space and times fixed the results are smooth functions of the moduli, the
relaxation times and the history.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.indentation.compliance import Compliance
from gfmdlayer.indentation.march import Marched
from gfmdlayer.indentation.space import History, LeftGridError, Space, find_space, make_space, march_on
from gfmdlayer.punch.revolution import Revolution


def graded_steps(knots: FloatArray, shortest: float) -> FloatArray:
    """Steps that grow from each knot on, from a part of the shortest time to an eighth of the way."""
    found = [knots[:1]]
    for begin, end in pairwise(knots.tolist()):
        largest, at = (end - begin) / 8, 0.0
        step = min(largest, 0.3 * shortest)
        ends = []
        while at + step < end - begin:
            at += step
            ends.append(at)
            step = min(1.5 * step, largest)
        count = len(ends) + 1
        stretch = 1.0 if not ends else (end - begin) / (at + step)
        found.append(np.append(begin + stretch * np.array(ends), end))
        assert found[-1].size == count
    return np.concatenate(found)


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
    found = []
    for begin, end in pairwise(knots.tolist()):
        inside = (t[:-1] >= begin) & (t[:-1] < end)
        lengths, own = np.diff(t)[inside], density[inside]
        # A jump of the slope of the force, where contact is lost, must not attract all the times.
        total = (own * lengths).sum()
        own = np.minimum(own, 8 * total / (end - begin)) + (0.2 * total + 3 * spread) / (end - begin)
        level = np.concatenate(([0.0], np.cumsum(own * lengths)))
        count = max(1, math.ceil(level[-1] / spread))
        edges = np.append(t[:-1][inside], end)
        found.append(np.interp(np.linspace(0, level[-1], count + 1)[:-1], level, edges))
        found[-1][0] = begin
    return np.append(np.concatenate(found), knots[-1])


def corners(history: History, tolerance: float) -> FloatArray:
    """Return the times between which a history is linear, within a part of its largest value.

    By Douglas and Peucker's rule.
    """
    t, values = history.time, history.value
    allowed = tolerance * float(np.abs(values).max())
    kept: BoolArray = np.zeros(t.size, dtype=bool)
    kept[[0, -1]] = True
    stack = [(0, t.size - 1)]
    while stack:
        i, j = stack.pop()
        if j - i < 2:
            continue
        line = values[i] + (values[j] - values[i]) * (t[i + 1 : j] - t[i]) / (t[j] - t[i])
        away = np.abs(values[i + 1 : j] - line)
        k = i + 1 + int(away.argmax())
        if away[k - i - 1] > allowed:
            kept[k] = True
            stack += [(i, k), (k, j)]
    return np.asarray(t[kept])


# Error of interpolation over the tolerance, for the first mesh; measured, mostly enough.
_FIRST_ERROR = 80.0

_MOST_MESHES, _MOST_STEPS, _MOST_SPACES, _GROWTH = 6, 5000, 12, 1.3


class Indentation(NamedTuple):
    """Columns of an indentation, each of shape (nt,)."""

    time: FloatArray
    force: FloatArray
    depth: FloatArray
    radius: FloatArray  # 0 without contact
    stored: FloatArray
    dissipated: FloatArray
    rise: FloatArray  # 0 where pressure and gap are surely not negative, see `march.Marched`
    error: float  # largest estimated error of force, depth and radius, relative to their largest; or NaN
    solutions: int  # solved integral equations
    fields: Marched | None = None  # with the fields at the snapshots
    space: Space | None = None


def on_steps(
    body: Body | Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    adhesion: float = 0.0,
    snapshots: FloatArray | None = None,
) -> Indentation:
    """Follow a history on given times: the ends of the steps, among them its breakpoints and snapshots.

    The body may be given by its compliance at the nodes of the space; with adhesion it is elastic. Raises
    LeftGridError if the contact grows beyond the space, ArithmeticError if a contact radius is not found.
    """
    made = body if isinstance(body, Compliance) else space.compliance(body)
    found = march_on(made, space, profile, history, time, adhesion, snapshots)
    return Indentation(
        time, found.force, found.depth, found.radius, found.stored, found.dissipated, found.rise,
        math.nan, found.solutions, found, space,
    )  # fmt: skip


def on_halved_steps(
    body: Body | Compliance,
    space: Space,
    profile: Revolution,
    history: History,
    time: FloatArray,
    snapshots: FloatArray | None = None,
) -> Indentation:
    """Follow a history on given times and their middles, without the error of second order in the step.

    The arguments are those of `on_steps`. The result has 2 nt - 1 times, and the estimated error of the
    shorter steps.
    """
    made = body if isinstance(body, Compliance) else space.compliance(body)
    both = np.empty(2 * time.size - 1)
    both[::2], both[1::2] = time, (time[1:] + time[:-1]) / 2
    fine = on_steps(made, space, profile, history, both, 0.0, snapshots)
    coarse = on_steps(made, space, profile, history, time)
    gains = {
        name: np.interp(both, time, (getattr(fine, name)[::2] - getattr(coarse, name)) / 3)
        for name in ("force", "depth", "radius", "stored", "dissipated")
    }
    touching = (fine.radius > 0) & (np.interp(both, time, coarse.radius) > 0)
    # Where contact is lost the radius falls like a root of time: its error is weighted by the force.
    share = np.where(touching, np.abs(fine.force) / max(np.abs(fine.force).max(), 1e-300), 0.0)
    error = max(
        _relative(gains["force"], fine.force),
        _relative(gains["depth"], fine.depth),
        _relative(gains["radius"] * share, fine.radius),
    )
    better = {name: getattr(fine, name) + gain for name, gain in gains.items()}
    for name in ("force", "radius"):
        better[name] = np.where(touching, np.maximum(better[name], 0.0), getattr(fine, name))
    return fine._replace(**better, error=error, solutions=fine.solutions + coarse.solutions)


def _relative(error: FloatArray, values: FloatArray) -> float:
    largest = float(np.abs(values).max())
    return float(np.abs(error).max()) / largest if largest > 0 else 0.0


def follow(
    body: Body,
    profile: Revolution,
    history: History,
    *,
    tolerance: float = 1e-4,
    adhesion: float = 0.0,
    stops: Sequence[float] = (),
    snapshots: Sequence[float] = (),
    space: Space | None = None,
) -> Indentation:
    """Follow a history on steps chosen for a tolerance.

    Parameters
    ----------
    tolerance : float
        Error of force, depth and contact radius, relative to the largest of each; `error` of the result is
        above it if it was not reached.
    stops, snapshots : sequence of float
        Times to land on; fields are kept at the snapshots.
    space : Space, optional
        Nodes in q and x; by default from `find_space`.

    Raises
    ------
    ValueError
        If the body does not support an isolated load.
    ArithmeticError
        If a contact radius is not found.
    """
    space = space or find_space(body, profile, history, tolerance, adhesion)
    kept = np.unique(np.array(snapshots, dtype=float))
    knots = np.unique(np.concatenate((corners(history, 0.1 * tolerance), kept, np.array(stops, dtype=float))))
    return in_growing_space(
        lambda space: _to_tolerance(
            space.compliance(body), space, profile, history, (knots, kept), tolerance, adhesion
        ),
        space,
        profile,
        tolerance,
    )


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
    landing: tuple[FloatArray, FloatArray],
    tolerance: float,
    adhesion: float,
) -> Indentation:
    """Choose steps by a coarse run, and refine them until the estimated error is within the tolerance."""
    knots, kept = landing
    shortest = min(
        (float(each.min()) for each in (body.local_times, body.times) if each.size), default=math.inf
    )
    first = on_steps(body, space, profile, history, graded_steps(knots, shortest), adhesion)
    if math.isinf(shortest):
        time = even_steps(first, knots, 0.1)
        return on_steps(body, space, profile, history, time, adhesion, kept)._replace(error=0.0)
    spread, found = math.sqrt(_FIRST_ERROR * tolerance), first
    for _ in range(_MOST_MESHES):
        time = even_steps(found, knots, spread)
        found = on_halved_steps(body, space, profile, history, time, kept)
        if found.error <= tolerance or time.size > _MOST_STEPS:
            break
        spread *= max(0.3, 0.8 * math.sqrt(tolerance / found.error))
    return found


def work_done(force: FloatArray, depth: FloatArray, start: float) -> FloatArray:
    """Integral of the force over the depth along a curve, from the work `start` at its first point.

    Between two points it is the mean over the parabolas through their neighbours on either side, where the
    depth goes on in the same direction; elsewhere the trapezoidal rule.
    """
    if force.size < 2:
        return np.full(force.size, start)
    width = np.diff(depth)
    slope = np.divide(np.diff(force), width, out=np.zeros_like(width), where=width != 0)
    areas = width * (force[1:] + force[:-1]) / 2
    if width.size > 1:
        smooth = width[1:] * width[:-1] > 0
        span = np.where(smooth, depth[2:] - depth[:-2], 1.0)
        bend = np.where(smooth, np.diff(slope) / span, 0.0)  # divided difference at the inner points
        number = np.zeros(width.size)
        total = np.zeros(width.size)
        for part in (slice(None, -1), slice(1, None)):
            total[part] += bend
            number[part] += smooth
        areas -= np.divide(total, number, out=np.zeros_like(total), where=number > 0) * width**3 / 6
    return start + np.concatenate(([0.0], np.cumsum(areas)))
