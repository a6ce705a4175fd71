"""Extension of the pressure in a window to the state of the whole surface, with its assessment."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.window_state import Pair, Surface, Window, stretch
from gfmdlayer.contact.pressure_form import State
from gfmdlayer.contact.residual import scales, violation
from gfmdlayer.grid.transforms import backward, forward
from gfmdlayer.kernels import LANES, kernel


@kernel(inner=True)
def extend_to_surface(
    window: Window, origin: Pair, surface: Surface, state: State
) -> tuple[float, tuple[float, float, float, float]]:
    """Write the state of the whole surface; two transforms.

    Returns
    -------
    Overlap that was cut off, as part of the depth, and what `assess` would return.
    """
    largest, total = _scatter(window, origin, state.p)
    forward(surface.plans, state.p, surface.spectrum)
    _deform(surface, state.spectrum)
    backward(surface.plans, surface.spectrum, surface.z)
    overlap, lowest, gaps = _clamp(surface, window.work.now[0].rigid_shift, state)
    size, load, runs = state.u.size, window.system.load_given, window.contact.runs
    if load:
        state.spectrum[0] = _sum(surface.h) - gaps
    mean = state.spectrum[0].real / size
    pressure_scale, depth = scales(largest, max(mean, 0.0) - lowest, window.system.floor)
    per_pressure, per_gap, worst, touching = 1.0 / pressure_scale, 1.0 / depth, 0.0, 0.0
    for k in range(window.contact.counts[0].runs):
        for part in range(2):
            _, there, count = stretch(window, origin, runs[k, 0], runs[k, 1] - runs[k, 0], part)
            for i in range(there, there + count):
                worst = max(worst, violation(state.p[i], state.gap[i], per_pressure, per_gap))
                touching += 1.0 if state.p[i] * per_pressure > state.gap[i] * per_gap else 0.0
    finite = np.isfinite(total) and np.isfinite(gaps)
    return overlap / depth, (worst if finite else np.nan, touching / size, total / size, gaps / size)


@kernel(inner=True)
def _scatter(window: Window, origin: Pair, p: FloatArray) -> tuple[float, float]:
    """Write the pressure, where it is not zero; return its maximum and its sum."""
    largest, total = 0.0, 0.0
    for k in range(window.contact.counts[0].runs):
        first, end = window.contact.runs[k, 0], window.contact.runs[k, 1]
        for part in range(2):
            here, there, count = stretch(window, origin, first, end - first, part)
            for i in range(count):
                pressure = window.at.p[here + i]
                p[there + i] = pressure
                total += pressure
                largest = max(largest, pressure)
    return largest, total


@kernel(reorder=True, inner=True)
def _deform(surface: Surface, spectrum: ComplexArray) -> None:
    """From the transform of the pressure to that of the displacement, per point and unnormalised."""
    size = surface.z.size
    for k in range(spectrum.size):
        u = surface.compliance[k] * (surface.b[k] - surface.spectrum[k])
        surface.spectrum[k] = u
        spectrum[k] = size * u


@kernel(reorder=True, inner=True)
def _clamp(surface: Surface, rigid_shift: float, state: State) -> tuple[float, float, float]:
    """Write displacement and gap without overlap; return the overlap, the lowest u, and the sum of gaps."""
    overlap, lowest, gaps = np.zeros(LANES), np.full(LANES, np.inf), 0.0
    for first in range(0, surface.z.size, LANES):
        z, h = surface.z[first : first + LANES], surface.h[first : first + LANES]
        us, apart = state.u[first : first + LANES], state.gap[first : first + LANES]
        # In several loops: for one loop over all of these arrays the compiler assumes that they may overlap,
        # and does not vectorise it.
        for i in range(z.size):
            apart[i] = h[i] - (z[i] + rigid_shift)
        for i in range(z.size):
            us[i] = min(h[i], z[i] + rigid_shift)
        for i in range(z.size):
            overlap[i] = apart[i] if apart[i] < overlap[i] else overlap[i]
            lowest[i] = us[i] if us[i] < lowest[i] else lowest[i]
            apart[i] = 0.0 if apart[i] < 0.0 else apart[i]
            gaps += apart[i]
    return -overlap.min(), lowest.min(), gaps


@kernel(reorder=True, inner=True)
def _sum(x: FloatArray) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total
