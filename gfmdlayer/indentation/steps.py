"""The steps of an indentation: graded behind kinks, or evened out by a run that is known."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Protocol

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.indentation.history import History


class Curves(Protocol):
    """Curves over time, each of shape (nt,)."""

    @property
    def time(self) -> FloatArray:
        """Times."""
        ...

    @property
    def force(self) -> FloatArray:
        """Force."""
        ...

    @property
    def depth(self) -> FloatArray:
        """Depth."""
        ...

    @property
    def radius(self) -> FloatArray:
        """Contact radius."""
        ...


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


def even_steps(run: Curves, knots: FloatArray, spread: float) -> FloatArray:
    """Times for which the error of linear interpolation between them is even (de Boor).

    Parameters
    ----------
    run : Indentation
        A run whose force, depth and radius bend as those wanted.
    knots : ndarray
        Times that are among them.
    spread : float
        Square root of eight times that error, relative to the largest value.
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
        # A kink of the force itself, where contact is lost, must not draw all the times.
        total = (own * lengths).sum()
        own = np.minimum(own, 8 * total / (end - begin)) + (0.2 * total + 3 * spread) / (end - begin)
        level = np.concatenate(([0.0], np.cumsum(own * lengths)))
        count = max(1, math.ceil(level[-1] / spread))
        edges = np.append(t[:-1][inside], end)
        found.append(np.interp(np.linspace(0, level[-1], count + 1)[:-1], level, edges))
        found[-1][0] = begin
    return np.append(np.concatenate(found), knots[-1])


def corners(history: History, tolerance: float) -> FloatArray:
    """Return the times of a history between which it is linear, but for a part of its largest value.

    Parameters
    ----------
    history : History
        What is prescribed.
    tolerance : float
        The part (Douglas and Peucker's rule).
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
