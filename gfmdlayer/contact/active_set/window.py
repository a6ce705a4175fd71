"""A step of the active-set solver in a window around the contact, compiled; see `windows`."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.extension import extend_to_surface
from gfmdlayer.contact.active_set.loop import iterate
from gfmdlayer.contact.active_set.state import list_runs
from gfmdlayer.contact.active_set.window_state import Found, Pair, Whole, Window, stretch
from gfmdlayer.contact.pressure_form import AIM, CLOSE
from gfmdlayer.contact.problem import Assessment
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.kernels import kernel

_APART = 1e150  # gap of the points that the window's transforms have beyond the window
_WELL_WITHIN = 0.95  # part of the tolerance within which a state is handed on
_MORE, _MORE_OF_TOLERANCE = 1e-12, 0.01  # the gap that is left at least, as part of depth and tolerance


@kernel
def solve(
    window: Window,
    origin: Pair,
    whole: Whole,
    guess: FloatArray,
    load: float,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int, int, float, Assessment, Found]:
    """Solve in the window at an origin, which holds the guess of the pressure.

    Returns whether that was done: not where the solve leaves its rounds and limit.
    Then the transforms of the whole surface and of the window, the iterations; by how much of its depth the
    surface that the pressure makes overlaps, which is cut off; its judgement, and the surface.
    """
    _release(whole)
    inside, transforms, iterations = _inside(window, origin, whole, guess, load, tolerance, rounds, limit)
    if not inside:
        nothing = np.empty(0)
        found = Found(nothing, nothing, nothing, np.empty(0, dtype=np.complex128))
        return False, 1, transforms, iterations, 0.0, (np.nan, 0.0, 0.0, 0.0), found
    size = whole.z.size
    found = Found(np.empty(size), np.zeros(size), np.empty(size), np.empty(whole.b.size, dtype=np.complex128))
    overlap, judgement = extend_to_surface(window, origin, whole, found)
    return True, 3, transforms, iterations, overlap, judgement, found


@kernel(reorder=True)
def overlaps(whole: Whole) -> FloatArray:
    """By how much the surface without pressure overlaps; a transform of the whole surface."""
    _release(whole)
    overlap = np.empty(whole.z.size)
    for i in range(overlap.size):
        overlap[i] = max(whole.z[i] - whole.h[i], 0.0)
    return overlap


@kernel
def respond(plans: Plans, compliance: FloatArray, spectrum: ComplexArray, kernel: FloatArray) -> None:
    """Write what pressure at the first point of a surface does to its points."""
    for k in range(spectrum.size):
        spectrum[k] = compliance[k]
    backward(plans, spectrum, kernel)


@kernel
def restrict(window: Window, kernel: FloatArray, stiffness: FloatArray) -> None:
    """Write compliance and stiffness of the window's transforms: see `windows`.

    From the kernel and the stiffness of the whole surface.
    """
    (rows, line), (window_rows, length) = window.whole, window.length
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
    modes, of_whole, share = length // 2 + 1, line // 2 + 1, part * (rows // window_rows)
    for row in range(window_rows):
        first = row * (rows // window_rows) * of_whole
        for k in range(modes):
            system.stiffness[row * modes + k] = share * stiffness[first + k * part]


@kernel
def _inside(
    window: Window,
    origin: Pair,
    whole: Whole,
    guess: FloatArray,
    load: float,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int]:
    """Find contact and pressure in the window; return whether they were, the transforms, the iterations."""
    at, contact, work, system = window.at, window.contact, window.work, window.system
    carried = _gather(window, origin, whole, guess)
    if not 0.0 < carried < np.inf:
        return False, 0, 0
    if system.load:
        share = load * whole.h.size / carried
        for i in range(at.p.size):
            at.p[i] *= share
    window.bank.age[:] = 0
    work.level[:], work.scales[:], work.exact[0] = 0.0, 0.0, False
    work.level[1] = whole.compliance[0] * whole.b[0].real
    list_runs(contact)
    plans, bank = window.plans, window.bank
    found, transforms, iterations = iterate(
        plans, system, at, contact, bank, work, 0.0, CLOSE * tolerance, rounds, limit, True
    )
    if not (found and contact.counts[2] > 0):
        return False, transforms, iterations
    if not _clear(window, tolerance):
        # A gap in the contact is aimed at that is more than what the gaps differ by.
        within = AIM * tolerance
        shift = within * work.scales[1]
        found, more, done = iterate(plans, system, at, contact, bank, work, shift, within, rounds, limit)
        transforms, iterations = transforms + more, iterations + done
        found = found and _clear(window, tolerance)
    return found, transforms, iterations


@kernel(reorder=True)
def _release(whole: Whole) -> None:
    """The surface without pressure."""
    for k in range(whole.b.size):
        whole.spectrum[k] = whole.compliance[k] * whole.b[k]
    backward(whole.plans, whole.spectrum, whole.z)


@kernel(reorder=True)
def _gather(window: Window, origin: Pair, whole: Whole, guess: FloatArray) -> float:
    """Copy problem and guess; return what the guess carries."""
    gap0, h, p, member = window.system.gap0, window.system.h, window.at.p, window.contact.member
    gap0[:], h[:], p[:], member[:] = _APART, 2.0 * _APART, 0.0, 0.0
    carried = 0.0
    for row in range(window.width[0]):
        for part in range(2):
            here, there, count = stretch(window, origin, row * window.length[1], window.width[1], part)
            hs, zs, guessed = (
                whole.h[there : there + count],
                whole.z[there : there + count],
                guess[there : there + count],
            )
            gap0s, h_s, ps = gap0[here : here + count], h[here : here + count], p[here : here + count]
            members = member[here : here + count]
            for i in range(count):
                gap0s[i], h_s[i] = hs[i] - zs[i], hs[i]
                ps[i] = guessed[i] if guessed[i] > 0.0 else 0.0
                members[i] = 1.0 if guessed[i] > 0.0 else 0.0
                carried += ps[i]
    return carried


@kernel
def _clear(window: Window, tolerance: float) -> bool:
    """Let nothing in the window overlap, as `dual.raise_clear` does, and by a little more than rounding.

    Return whether that leaves the contact within the tolerance; else do nothing.
    """
    at, gap0, contact = window.at, window.system.gap0, window.contact
    depth, lift, lowest, widest = window.work.scales[1], 0.0, 0.0, 0.0
    least = min(_MORE, _MORE_OF_TOLERANCE * tolerance) * depth
    for k in range(contact.counts[1]):
        for i in range(contact.near[k, 0], contact.near[k, 1]):
            effect, gap = at.gap[i] - gap0[i], at.gap[i]
            lowest = min(lowest, gap)
            if effect > 0.0 and gap < least:
                lift = max(lift, (least - gap) / effect)
            elif gap < 0.0:
                lift = np.inf
    if window.system.load:
        window.work.level[2] += lowest - least
        return True
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            widest = max(widest, at.gap[i] + lift * (at.gap[i] - gap0[i]))
    if not widest <= _WELL_WITHIN * tolerance * depth:
        return False
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            at.p[i] *= 1.0 + lift
    return True
