"""From the pressure in a window to the state of the whole surface, and its judgement; see `windows`."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.window_state import Found, Pair, Whole, Window, stretch
from gfmdlayer.contact.problem import Assessment, scales, violation
from gfmdlayer.grid.transforms import backward, forward
from gfmdlayer.kernels import LANES, kernel


@kernel
def extend_to_surface(window: Window, origin: Pair, whole: Whole, found: Found) -> tuple[float, Assessment]:
    """Write the state of the whole surface; return by how much of its depth it overlaps, and judge it.

    Two transforms.
    """
    largest, total = _scatter(window, origin, found.p)
    forward(whole.plans, found.p, whole.spectrum)
    _deform(whole, found.spectrum)
    backward(whole.plans, whole.spectrum, whole.z)
    overlap, lowest, gaps = _settle(whole, window.work.level[2], found)
    size, load, runs = found.u.size, window.system.load, window.contact.runs
    if load:
        found.spectrum[0] = _sum(whole.h) - gaps
    mean = found.spectrum[0].real / size
    pressure_scale, depth = scales(largest, max(mean, 0.0) - lowest, window.system.least)
    per_pressure, per_gap, worst, touching = 1.0 / pressure_scale, 1.0 / depth, 0.0, 0.0
    for k in range(window.contact.counts[0]):
        for part in range(2):
            _, there, count = stretch(window, origin, runs[k, 0], runs[k, 1] - runs[k, 0], part)
            for i in range(there, there + count):
                worst = max(worst, violation(found.p[i], found.gap[i], per_pressure, per_gap))
                touching += 1.0 if found.p[i] * per_pressure > found.gap[i] * per_gap else 0.0
    known = np.isfinite(total) and np.isfinite(gaps)
    return overlap / depth, (worst if known else np.nan, touching / size, total / size, gaps / size)


@kernel
def _scatter(window: Window, origin: Pair, p: FloatArray) -> tuple[float, float]:
    """Write the pressure, where it is not zero; return its maximum and its sum."""
    largest, total = 0.0, 0.0
    for k in range(window.contact.counts[0]):
        first, end = window.contact.runs[k, 0], window.contact.runs[k, 1]
        for part in range(2):
            here, there, count = stretch(window, origin, first, end - first, part)
            for i in range(count):
                pressure = window.at.p[here + i]
                p[there + i] = pressure
                total += pressure
                largest = max(largest, pressure)
    return largest, total


@kernel(reorder=True)
def _deform(whole: Whole, spectrum: ComplexArray) -> None:
    """From the transform of the pressure to that of the displacement, per point and unnormalised."""
    size = whole.z.size
    for k in range(spectrum.size):
        u = whole.compliance[k] * (whole.b[k] - whole.spectrum[k])
        whole.spectrum[k] = u
        spectrum[k] = size * u


@kernel(reorder=True)
def _settle(whole: Whole, yielded: float, found: Found) -> tuple[float, float, float]:
    """Write displacement and gap, cut off what overlaps; return the most of it, the deepest u, all gaps."""
    overlap, lowest, gaps = np.zeros(LANES), np.full(LANES, np.inf), 0.0
    for first in range(0, whole.z.size, LANES):
        z, h = whole.z[first : first + LANES], whole.h[first : first + LANES]
        us, apart = found.u[first : first + LANES], found.gap[first : first + LANES]
        # In several loops: of one that writes to all of these arrays the compiler cannot tell that they lie
        # apart, and the vector units stay idle.
        for i in range(z.size):
            apart[i] = h[i] - (z[i] + yielded)
        for i in range(z.size):
            us[i] = min(h[i], z[i] + yielded)
        for i in range(z.size):
            overlap[i] = apart[i] if apart[i] < overlap[i] else overlap[i]
            lowest[i] = us[i] if us[i] < lowest[i] else lowest[i]
            apart[i] = 0.0 if apart[i] < 0.0 else apart[i]
            gaps += apart[i]
    return -overlap.min(), lowest.min(), gaps


@kernel(reorder=True)
def _sum(x: FloatArray) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total
