"""A step of the active-set solver in a window around the contact, compiled; see `windows`."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.contact.active_set_loop import iterate
from gfmdlayer.contact.active_set_state import Bank, ContactSet, Work, list_runs
from gfmdlayer.contact.dual import Iterate, System
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH, LANES, Judgement, scales, violation
from gfmdlayer.contact.transforms import ComplexArray, Plans, backward, forward

_APART = 1e150  # gap of the points that the window's transforms have beyond the window
_CLOSE = 0.8  # part of the tolerance within which the solve ends
_AIM = 0.25  # likewise where a gap in the contact is aimed at, and that gap, as part of the depth
_MORE, _MORE_OF_SLACK = 1e-12, 0.1  # the gap that is left at least, as part of depth and of the slack

Pair = tuple[int, int]


class Window(NamedTuple):
    """A window and the problem in it.

    Axes are two, the first of one point where the surface is a line. The window is the first points of its
    transforms, along each axis.
    """

    plans: Plans
    system: System
    at: Iterate
    contact: ContactSet
    bank: Bank
    work: Work
    length: Pair  # of the transforms
    width: Pair  # of the window
    whole: Pair  # points of the surface


class Whole(NamedTuple):
    """The surface that the window is part of."""

    plans: Plans
    compliance: FloatArray  # as in `System`
    h: FloatArray
    free: ComplexArray  # transform of the surface without pressure, per point
    spectrum: ComplexArray  # work array
    z: FloatArray  # work array


class Found(NamedTuple):
    """The state of the whole surface that a window's pressure leads to, to be written to."""

    u: FloatArray
    p: FloatArray
    gap: FloatArray
    spectrum: ComplexArray  # of u, unnormalised


@nb.njit(nogil=True, cache=True)
def solve(
    window: Window,
    origin: Pair,
    whole: Whole,
    b: ComplexArray,
    guess: FloatArray,
    load: float,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int, int, float, Judgement, Found]:
    """Solve in the window at an origin, which holds the guess of the pressure.

    Returns whether that was done: not where the solve leaves its rounds and limit.
    Then the transforms of the whole surface and of the window, the iterations; by how much of its depth the
    surface that the pressure makes overlaps, which is cut off; its judgement, and the surface.
    """
    _release(whole, b)
    inside, transforms, iterations = _inside(window, origin, whole, guess, load, tolerance, rounds, limit)
    if not inside:
        nothing = np.empty(0)
        found = Found(nothing, nothing, nothing, np.empty(0, dtype=np.complex128))
        return False, 1, transforms, iterations, 0.0, (np.nan, 0.0, 0.0, 0.0), found
    size = whole.z.size
    found = Found(
        np.empty(size), np.zeros(size), np.empty(size), np.empty(whole.free.size, dtype=np.complex128)
    )
    overlap, judgement = _widen(window, origin, whole, found)
    return True, 3, transforms, iterations, overlap, judgement, found


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def overlaps(whole: Whole, b: ComplexArray) -> FloatArray:
    """By how much the surface without pressure overlaps; a transform of the whole surface."""
    _release(whole, b)
    overlap = np.empty(whole.z.size)
    for i in range(overlap.size):
        overlap[i] = max(whole.z[i] - whole.h[i], 0.0)
    return overlap


@nb.njit(nogil=True, cache=True)
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
    work.level[1] = whole.free[0].real
    list_runs(contact)
    plans, bank = window.plans, window.bank
    found, transforms, iterations = iterate(
        plans, system, at, contact, bank, work, 0.0, _CLOSE * tolerance, rounds, limit
    )
    if not (found and contact.counts[2] > 0):
        return False, transforms, iterations
    if not _clear(window, (1.0 - _CLOSE) * tolerance):
        # A gap in the contact is aimed at that is more than what the gaps differ by.
        within = _AIM * tolerance
        shift = within * work.scales[1]
        found, more, done = iterate(plans, system, at, contact, bank, work, shift, within, rounds, limit)
        transforms, iterations = transforms + more, iterations + done
        found = found and _clear(window, (1.0 - 2.0 * _AIM) * tolerance)
    return found, transforms, iterations


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _release(whole: Whole, b: ComplexArray) -> None:
    """The surface without pressure."""
    free, spectrum = whole.free, whole.spectrum
    for k in range(free.size):
        free[k] = spectrum[k] = whole.compliance[k] * b[k]
    backward(whole.plans, spectrum, whole.z)


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _gather(window: Window, origin: Pair, whole: Whole, guess: FloatArray) -> float:
    """Copy problem and guess; return what the guess carries."""
    gap0, h, p, member = window.system.gap0, window.system.h, window.at.p, window.contact.member
    gap0[:], h[:], p[:], member[:] = _APART, 2.0 * _APART, 0.0, 0.0
    carried = 0.0
    for row in range(window.width[0]):
        for part in range(2):
            here, there, count = _stretch(window, origin, row * window.length[1], window.width[1], part)
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


@nb.njit(nogil=True, cache=True)
def _clear(window: Window, slack: float) -> bool:
    """Let nothing in the window overlap, as `dual.raise_clear` does, and by a little more than rounding.

    Return whether that opens the contact by no more than ``slack``, as part of the depth; else do nothing.
    """
    at, gap0, depth = window.at, window.system.gap0, window.work.scales[1]
    least, lift, lowest, most = min(_MORE, _MORE_OF_SLACK * slack) * depth, 0.0, 0.0, 0.0
    for k in range(window.contact.counts[1]):
        for i in range(window.contact.near[k, 0], window.contact.near[k, 1]):
            effect, gap = at.gap[i] - gap0[i], at.gap[i]
            lowest, most = min(lowest, gap), max(most, effect)
            if effect > 0.0 and gap < least:
                lift = max(lift, (least - gap) / effect)
            elif gap < 0.0:
                lift = np.inf
    if window.system.load:
        window.work.level[2] += lowest - least
        return True
    if lift * most > slack * depth:
        return False
    for k in range(window.contact.counts[0]):
        for i in range(window.contact.runs[k, 0], window.contact.runs[k, 1]):
            at.p[i] *= 1.0 + lift
    return True


@nb.njit(nogil=True, cache=True)
def _widen(window: Window, origin: Pair, whole: Whole, found: Found) -> tuple[float, Judgement]:
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
    pressure_scale, depth = scales(largest, max(mean, 0.0) - lowest, window.system.softest)
    per_pressure, per_gap, worst, touching = 1.0 / pressure_scale, 1.0 / depth, 0.0, 0.0
    for k in range(window.contact.counts[0]):
        for part in range(2):
            _, there, count = _stretch(window, origin, runs[k, 0], runs[k, 1] - runs[k, 0], part)
            for i in range(there, there + count):
                worst = max(worst, violation(found.p[i], found.gap[i], per_pressure, per_gap))
                touching += 1.0 if found.p[i] * per_pressure > found.gap[i] * per_gap else 0.0
    known = np.isfinite(total) and np.isfinite(gaps)
    return overlap / depth, (worst if known else np.nan, touching / size, total / size, gaps / size)


@nb.njit(nogil=True, cache=True)
def _stretch(window: Window, origin: Pair, first: int, count: int, part: int) -> tuple[int, int, int]:
    """Where a stretch of a line of the window is on the surface, whose lines go on at their beginning.

    Returns, of its points before (part 0) or after the end of the surface's line, the first in the window,
    the first on the surface, and their number.
    """
    (rows, line), length = window.whole, window.length[1]
    start = (origin[0] + first // length) % rows * line
    column = origin[1] + first % length
    before = min(max(line - column, 0), count)
    if part == 0:
        return first, start + column, before
    return first + before, start + column + before - line, count - before


@nb.njit(nogil=True, cache=True)
def _scatter(window: Window, origin: Pair, p: FloatArray) -> tuple[float, float]:
    """Write the pressure, where it is not zero; return its maximum and its sum."""
    largest, total = 0.0, 0.0
    for k in range(window.contact.counts[0]):
        first, end = window.contact.runs[k, 0], window.contact.runs[k, 1]
        for part in range(2):
            here, there, count = _stretch(window, origin, first, end - first, part)
            for i in range(count):
                pressure = window.at.p[here + i]
                p[there + i] = pressure
                total += pressure
                largest = max(largest, pressure)
    return largest, total


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _deform(whole: Whole, spectrum: ComplexArray) -> None:
    """From the transform of the pressure to that of the displacement, per point and unnormalised."""
    size = whole.z.size
    for k in range(spectrum.size):
        u = whole.free[k] - whole.compliance[k] * whole.spectrum[k]
        whole.spectrum[k] = u
        spectrum[k] = size * u


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _settle(whole: Whole, yielded: float, found: Found) -> tuple[float, float, float]:
    """Write displacement and gap, cut off what overlaps; return the most of it, the deepest u, all gaps."""
    overlap, lowest, gaps = np.zeros(LANES), np.full(LANES, np.inf), 0.0
    for first in range(0, whole.z.size, LANES):
        z, h = whole.z[first : first + LANES], whole.h[first : first + LANES]
        us, apart = found.u[first : first + LANES], found.gap[first : first + LANES]
        for i in range(z.size):
            raised = z[i] + yielded
            gap = h[i] - raised
            overlap[i] = gap if gap < overlap[i] else overlap[i]
            u = h[i] if gap < 0.0 else raised  # NaN stays
            lowest[i] = u if u < lowest[i] else lowest[i]
            gap = 0.0 if gap < 0.0 else gap
            us[i], apart[i] = u, gap
            gaps += gap
    return -overlap.min(), lowest.min(), gaps


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _sum(x: FloatArray) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total
