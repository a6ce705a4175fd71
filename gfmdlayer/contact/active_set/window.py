"""A step of the active-set solver in a window around the contact, compiled; see `windows`."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.extension import extend_to_surface
from gfmdlayer.contact.active_set.loop import iterate
from gfmdlayer.contact.active_set.state import list_runs
from gfmdlayer.contact.active_set.window_state import Pair, Surface, Window, stretch
from gfmdlayer.contact.pressure_form import AIM, CLOSE, State
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.kernels import kernel

_APART = 1e150  # gap of the points that the window's transforms have beyond the window
_WELL_WITHIN = 0.95  # part of the tolerance within which a state is handed on
_MARGIN, _MARGIN_OF_TOLERANCE = 1e-12, 0.01  # least gap that is left, as part of depth and tolerance


@kernel
def solve(
    window: Window,
    origin: Pair,
    surface: Surface,
    guess: FloatArray,
    load: float,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int, int, float, tuple[float, float, float, float], State]:
    """Solve in a window.

    Parameters
    ----------
    window : Window
        Its arrays.
    origin : tuple of int
        Line and point of the surface where it begins.
    surface : Surface
        The problem on the whole surface.
    guess : ndarray, one value a point
        Of the pressure; the window holds what is positive.
    load : float
        Mean pressure where it is given.
    tolerance : float
        Of the residual.
    rounds, limit : int
        Most changes of the contact set, and iterations.

    Returns
    -------
    done, whole, shorter, iterations, overlap, assessment, state
        Whether contact and pressure were found; transforms of the whole surface and of the window;
        iterations; overlap of the whole surface that was cut off, as part of the depth; what `assess` would
        return; the state.
    """
    _free_surface(surface)
    at, contact, work, system = window.at, window.contact, window.work, window.system
    carried = _gather(window, origin, surface, guess)
    found = 0.0 < carried < np.inf
    if system.load_given:
        share = load * surface.h.size / carried
        for i in range(at.p.size):
            at.p[i] *= share
    now = work.now[0]
    now.exact, now.depth_scale, now.mean, now.rigid_shift = False, 0.0, 0.0, 0.0
    now.free_mean = surface.compliance[0] * surface.b[0].real
    list_runs(contact)
    shift, within, transforms, iterations, clear = 0.0, CLOSE * tolerance, 0, 0, False
    for attempt in range(2):
        if not found or clear:
            break
        found, more, done = iterate(
            window.plans, system, at, contact, work, shift, within, rounds, limit, attempt == 0
        )
        transforms, iterations = transforms + more, iterations + done
        found = found and (attempt > 0 or contact.counts[0].points > 0)
        clear = found and _raise_clear(window, tolerance)
        # Else aim at a gap in the contact that is larger than the differences of the gaps.
        within = AIM * tolerance
        shift = within * now.depth_scale
    if not clear:
        nothing = np.empty(0)
        state = State(nothing, nothing, nothing, np.empty(0, dtype=np.complex128))
        return False, 1, transforms, iterations, 0.0, (np.nan, 0.0, 0.0, 0.0), state
    size = surface.z.size
    spectrum = np.empty(surface.b.size, dtype=np.complex128)
    state = State(np.empty(size), np.zeros(size), np.empty(size), spectrum)
    overlap, assessment = extend_to_surface(window, origin, surface, state)
    return True, 3, transforms, iterations, overlap, assessment, state


@kernel(reorder=True)
def overlaps(surface: Surface) -> FloatArray:
    """Overlap of the surface without pressure; a transform of the whole surface."""
    _free_surface(surface)
    overlap = np.empty(surface.z.size)
    for i in range(overlap.size):
        overlap[i] = max(surface.z[i] - surface.h[i], 0.0)
    return overlap


@kernel
def respond(plans: Plans, compliance: FloatArray, spectrum: ComplexArray, kernel: FloatArray) -> None:
    """Write the displacement of all points by a pressure at the first; its sign is that of a gap."""
    for k in range(spectrum.size):
        spectrum[k] = compliance[k]
    backward(plans, spectrum, kernel)


@kernel
def restrict(window: Window, kernel: FloatArray, stiffness: FloatArray) -> None:
    """Write compliance and stiffness of the window's transforms, from kernel and stiffness of the surface."""
    (rows, line), (window_rows, length) = window.surface, window.length
    z, system, spectrum = window.work.z, window.system, window.work.spectrum
    half, part = (length + 1) // 2, line // length
    for row in range(window_rows):
        # The second half of each axis stands for the differences below zero.
        first = (row if row < (window_rows + 1) // 2 else row + rows - window_rows) * line
        for i in range(length):
            z[row * length + i] = kernel[first + (i if i < half else i + line - length)]
    forward(window.plans, z, spectrum)
    for k in range(spectrum.size):
        system.compliance[k] = spectrum[k].real / z.size
    modes, of_surface, share = length // 2 + 1, line // 2 + 1, part * (rows // window_rows)
    for row in range(window_rows):
        first = row * (rows // window_rows) * of_surface
        for k in range(modes):
            system.stiffness[row * modes + k] = share * stiffness[first + k * part]


@kernel(reorder=True, inner=True)
def _free_surface(surface: Surface) -> None:
    """Write the surface without pressure."""
    for k in range(surface.b.size):
        surface.spectrum[k] = surface.compliance[k] * surface.b[k]
    backward(surface.plans, surface.spectrum, surface.z)


@kernel(reorder=True, inner=True)
def _gather(window: Window, origin: Pair, surface: Surface, guess: FloatArray) -> float:
    """Copy problem and guess into the window; return the sum of the guess."""
    gap0, h, p, member = window.system.gap0, window.system.h, window.at.p, window.contact.member
    gap0[:], h[:], p[:], member[:] = _APART, 2.0 * _APART, 0.0, 0.0
    carried = 0.0
    for row in range(window.width[0]):
        for part in range(2):
            here, there, count = stretch(window, origin, row * window.length[1], window.width[1], part)
            for i in range(count):
                height, pressure = surface.h[there + i], guess[there + i]
                gap0[here + i], h[here + i] = height - surface.z[there + i], height
                if pressure > 0.0:
                    p[here + i], member[here + i] = pressure, 1.0
            # In a loop that writes nothing: the order of a sum in one that does depends on where arrays lie.
            for i in range(count):
                carried += guess[there + i] if guess[there + i] > 0.0 else 0.0
    return carried


@kernel(reorder=True, inner=True)
def _raise_clear(window: Window, tolerance: float) -> bool:
    """Raise the pressure until nothing in the window overlaps, by a little more than rounding.

    Under a given load the punch is shifted instead. Return whether the contact stays within the tolerance;
    else nothing is changed.
    """
    at, gap0, contact, now = window.at, window.system.gap0, window.contact, window.work.now[0]
    depth, lift, lowest, widest = now.depth_scale, 0.0, 0.0, 0.0
    margin = min(_MARGIN, _MARGIN_OF_TOLERANCE * tolerance) * depth
    for k in range(contact.counts[0].near):
        for i in range(contact.near[k, 0], contact.near[k, 1]):
            effect, gap = at.gap[i] - gap0[i], at.gap[i]
            lowest = min(lowest, gap)
            if effect > 0.0 and gap < margin:
                lift = max(lift, (margin - gap) / effect)
            elif gap < 0.0:
                lift = np.inf
    if window.system.load_given:
        now.rigid_shift += lowest - margin
        return True
    for k in range(contact.counts[0].runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            widest = max(widest, at.gap[i] + lift * (at.gap[i] - gap0[i]))
    if not widest <= _WELL_WITHIN * tolerance * depth:
        return False
    for k in range(contact.counts[0].runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            at.p[i] *= 1.0 + lift
    return True
