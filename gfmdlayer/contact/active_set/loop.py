"""The compiled loop of the active-set solver; see `solver` for the method and its symbols."""

from __future__ import annotations

from math import prod
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.contact.pressure_form import Iterate, System, apply_to
from gfmdlayer.contact.residual import scales
from gfmdlayer.grid.transforms import Plans, Reserve, backward
from gfmdlayer.kernels import LANES, filled, kernel, maximum, minimum, record_type, summed

_LINES = 2  # on either side that are close to a contact on a surface
REACH = 16  # points at least on either side of the contact where the gap is kept up to date
_BLOCK = 256  # points that are passed over at once where nothing is in contact


class ContactSet(NamedTuple):
    """The points in contact, as stretches of contiguous memory, along the last axis of a surface."""

    member: FloatArray  # 1 in the contact set C, 0 elsewhere
    runs: IntArray  # first point of each stretch, and the point after its last; shape (stretches, 2)
    near: IntArray  # likewise for the points in C or close to it
    counts: npt.NDArray[Any]  # one record: runs, near, points
    reach: tuple[int, int]  # points on either side that are close; points of a line
    close: FloatArray  # work array; empty on a line


class LoopArrays(NamedTuple):
    """Work arrays, and the scalars of the present state."""

    z: FloatArray
    spectrum: ComplexArray
    direction: FloatArray  # of conjugate gradients; 0 outside C
    change: FloatArray  # A direction
    pressure: FloatArray  # with which the present contact set was begun, in C
    pressure_change: FloatArray  # A pressure, near C
    now: npt.NDArray[Any]  # one record of `SCALARS`


COUNTS = record_type([("runs", np.int64), ("near", np.int64), ("points", np.int64)])
SCALARS = record_type(
    [
        ("exact", np.bool_),  # whether the gap is known at every point, or near the contact only
        ("pressure_scale", np.float64),  # of the residual
        ("depth_scale", np.float64),
        ("mean", np.float64),  # mean of u
        ("free_mean", np.float64),  # mean of u without pressure
        ("rigid_shift", np.float64),  # of the punch under load control: gap = gap0 + A p - rigid_shift
        ("energy", np.float64),  # p A p of `LoopArrays.pressure`; 0 where directions are not conjugate to it
    ]
)


def make_contact(shape: tuple[int, ...]) -> ContactSet:
    """An empty contact set on a surface of a shape."""
    size, line = prod(shape), shape[-1]
    return ContactSet(
        member=np.zeros(size),
        runs=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        near=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        counts=np.zeros(1, dtype=COUNTS),
        reach=(max(REACH, line // 64), line),
        close=np.empty(0 if line == size else size),
    )


def make_work(reserve: Reserve) -> LoopArrays:
    """Work arrays: five fields and a spectrum."""
    z, direction, change, pressure, pressure_change = (reserve.empty_field() for _ in range(5))
    now = np.zeros(1, dtype=SCALARS)
    return LoopArrays(z, reserve.empty_spectrum(), direction, change, pressure, pressure_change, now)


@kernel(inner=True, borrows=True)
def list_runs(contact: ContactSet) -> None:
    """Write down the stretches of the contact set."""
    counts = contact.counts[0]
    counts.runs, counts.points = _stretches(contact.member, contact.runs)


@kernel(inner=True, borrows=True)
def list_near(contact: ContactSet) -> None:
    """Write down the stretches close to the contact set; the gap must be known at all of them."""
    runs, near, close, size = contact.runs, contact.near, contact.close, contact.member.size
    counts, count, (reach, row) = contact.counts[0], 0, contact.reach
    if row < size:
        # On a surface the contact also spreads to the next lines.
        close[:] = 0.0
        for k in range(counts.runs):
            for line in range(-_LINES, _LINES + 1):
                first, end = runs[k, 0] - reach + line * row, runs[k, 1] + reach + line * row
                for i in range(max(first, 0), min(end, size)):
                    close[i] = 1.0
                for i in range(max(first + size, 0) if first < 0 else size, min(end + size, size)):
                    close[i] = 1.0
                for i in range(min(end - size, size)):
                    close[i] = 1.0
        counts.near, _ = _stretches(close, near)
        return
    for k in range(counts.runs):
        first, end = max(runs[k, 0] - reach, 0), min(runs[k, 1] + reach, size)
        if count > 0 and first <= near[count - 1, 1]:
            near[count - 1, 1] = end
        else:
            near[count, 0], near[count, 1] = first, end
            count += 1
    counts.near = count


@kernel(inner=True, borrows=True)
def _stretches(member: FloatArray, runs: IntArray) -> tuple[int, int]:
    """Write down the stretches of ones; return their number and the number of their points."""
    count, points, inside = 0, 0, False
    for first in range(0, member.size, _BLOCK):
        block = member[first : first + _BLOCK]
        total = _ones(block)
        points += int(total)
        if total == (block.size if inside else 0.0):
            continue
        for i in range(block.size):
            if (block[i] > 0.0) != inside:
                if inside:
                    runs[count, 1] = first + i
                    count += 1
                else:
                    runs[count, 0] = first + i
                inside = not inside
    if inside:
        runs[count, 1] = member.size
        count += 1
    return count, points


@kernel(reorder=True, inner=True, borrows=True)
def _ones(member: FloatArray) -> float:
    """Sum of zeros and ones, which is exact in any order."""
    total = 0.0
    for i in range(member.size):
        total += member[i]
    return total


@kernel(reorder=True, inner=True, borrows=True)
def dot(contact: ContactSet, x: FloatArray, y: FloatArray) -> float:
    """Sum of x y over the contact."""
    total = 0.0
    for k in range(contact.counts[0].runs):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        ys = y[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i] * ys[i]
    return total


@kernel(reorder=True, inner=True, borrows=True)
def mean(contact: ContactSet, x: FloatArray) -> float:
    """Mean of x over the contact."""
    total = 0.0
    for k in range(contact.counts[0].runs):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i]
    return float(total / contact.counts[0].points)


@kernel(reorder=True, inner=True, borrows=True)
def add(runs: IntArray, count: int, factor: float, x: FloatArray, y: FloatArray) -> None:
    """Add a multiple of x to y, over the contact or near it."""
    for k in range(count):
        xs, ys = x[runs[k, 0] : runs[k, 1]], y[runs[k, 0] : runs[k, 1]]
        for i in range(xs.size):
            ys[i] += factor * xs[i]


# Points under tension leave once the gaps in the contact are this part of the violations of the set.
_WELL_UNDER = 0.1
# And once this part of the tension, at most, came with the last iteration: else the contact sets of a stiff
# film on a soft base alternate.
_SETTLED = 0.3
_FAR = 1e300  # added to the gaps in the contact where only the others count


@kernel(reorder=True, borrows=True)
def begin(  # groups of arrays; one call takes less time than two
    plans: Plans,
    system: System,
    b: ComplexArray,
    free: ComplexArray,
    at: Iterate,
    contact: ContactSet,
    work: LoopArrays,
    guess: FloatArray,
    load: float,
) -> None:
    """Write the surface without pressure, a guess of the pressure, and the set where it is positive."""
    # ``load`` is the mean pressure where it is given. Half a pair of transforms.
    now = work.now[0]
    for k in range(free.size):
        free[k] = system.compliance[k] * b[k]
        work.spectrum[k] = free[k]
    now.free_mean = free[0].real
    backward(plans, work.spectrum, work.z)
    gap0, h = system.gap0, system.h
    for i in range(gap0.size):
        gap0[i] = h[i] - work.z[i]
    _set_guess(system, at, contact, guess, load)
    now.exact = False


@kernel(borrows=True)
def set_guess(system: System, at: Iterate, contact: ContactSet, guess: FloatArray, load: float) -> None:
    """`_set_guess` for Python."""
    _set_guess(system, at, contact, guess, load)


@kernel(reorder=True, inner=True, borrows=True)
def _set_guess(system: System, at: Iterate, contact: ContactSet, guess: FloatArray, load: float) -> None:
    """Take over a guess of the pressure, which may be anything, and the contact set where it is positive."""
    p, total = at.p, 0.0
    for i in range(p.size):
        p[i] = guess[i] if guess[i] > 0.0 else 0.0
        total += p[i]
    if system.load_given:
        if not (0.0 < total < np.inf and load * p.size / total < np.inf):
            p[:] = 0.0
            deepest = 0
            for i in range(p.size):
                if system.gap0[i] < system.gap0[deepest]:
                    deepest = i
            p[deepest] = total = 1.0
        share = load * p.size / total
        for i in range(p.size):
            p[i] *= share
    for i in range(p.size):
        contact.member[i] = 1.0 if p[i] > 0.0 else 0.0
    list_runs(contact)


@kernel(borrows=True)
def iterate(  # groups of arrays, and the limits of one call
    plans: Plans,
    system: System,
    at: Iterate,
    contact: ContactSet,
    work: LoopArrays,
    shift: float,
    tolerance: float,
    rounds: int,
    limit: int,
    checked: bool,
) -> tuple[bool, int, int]:
    """Find the contact set and its pressure."""
    # The gap need not be known at the beginning; pressure and gap are an exact pair on return. `shift` is the
    # gap in the contact that is aimed at [length], `rounds` the most changes of the contact set, `limit` the
    # most iterations. `checked` says that the caller evaluates the result on a larger surface: a contact of
    # one stretch, near which the gap is known, then needs no evaluation here.
    #
    # Returns whether set and pressure were found, the transforms and the iterations.
    transforms, now = 0, work.now[0]
    carried = summed(at.p) if system.load_given else 0.0
    if not now.exact:
        _evaluate(plans, system, at, work)
        transforms += 2
    restart, last, iteration, done = True, 0.0, 0, 0
    moved = 0.0  # largest change of the pressure in the last iteration, on a line
    list_near(contact)
    for iteration in range(limit):
        opened, tension, overlap = _violations(system, at, contact, work, shift)
        if restart:
            last = 0.0
            work.direction[:] = 0.0
            if _scale_pressure(system, at, contact, work, shift):
                now.exact = False
                opened, tension, overlap = _violations(system, at, contact, work, shift)
        known = now.exact or (checked and contact.counts[0].runs == 1)
        if max(opened, tension, overlap) <= tolerance and not known:
            _restore_load(system, at, contact, carried)
            _evaluate(plans, system, at, work)
            transforms, last = transforms + 2, 0.0
            opened, tension, overlap = _violations(system, at, contact, work, shift)
        if max(opened, tension, overlap) <= tolerance:
            return True, transforms, iteration
        # Overlapping points join at once; points under tension leave when the pressure is known well enough.
        joins = overlap > max(opened, tolerance)
        settled = opened <= _WELL_UNDER * tension and moved <= _SETTLED * tension * now.pressure_scale
        leaves = tension > 0.0 and (settled or opened <= tolerance)
        restart = joins or leaves
        if restart:
            if done == rounds:
                break
            done += 1
            if _change_set(at.p, at.gap, contact, shift, now.exact):
                _restore_load(system, at, contact, carried)
                _evaluate(plans, system, at, work)
                transforms += 2
            if now.exact:
                list_near(contact)
            moved = 0.0
            continue
        _precondition(plans, system, at, contact, work, shift)
        product, slope = _next_direction(system, at, contact, work, shift, 1.0 / last if last > 0.0 else 0.0)
        apply_to(plans, system.compliance, work.direction, work.spectrum, work.spectrum, work.change)
        transforms += 4
        curvature = dot(contact, work.direction, work.change)
        if not (curvature > 0.0 and slope > 0.0):
            if now.energy == 0.0:
                break
            now.energy, last = 0.0, 0.0  # rounding of the conjugacy to the pressure
            continue
        _step(at, contact, work, slope / curvature)
        moved = _largest_on_line(contact, work.direction) * slope / curvature
        now.exact, last = False, product
    if not now.exact:
        _restore_load(system, at, contact, carried)
        _evaluate(plans, system, at, work)
        transforms += 2
        _violations(system, at, contact, work, shift)
    return False, transforms, iteration


@kernel(reorder=True, inner=True, borrows=True)
def _evaluate(plans: Plans, system: System, at: Iterate, work: LoopArrays) -> None:
    """Gap of the pressure at every point, and the mean displacement; two transforms."""
    now = work.now[0]
    apply_to(plans, system.compliance, at.p, at.spectrum, work.spectrum, at.gap)
    for i in range(at.gap.size):
        at.gap[i] += system.gap0[i]
    now.mean = now.free_mean - system.mean_compliance * at.spectrum[0].real
    now.rigid_shift, now.exact = 0.0, True


@kernel(inner=True, borrows=True)
def _restore_load(system: System, at: Iterate, contact: ContactSet, carried: float) -> None:
    """Scale the pressure to a given load, which points that have left and rounding have changed."""
    if system.load_given:
        total = summed(at.p)
        factor = carried / total if total > 0.0 else 1.0
        for k in range(contact.counts[0].runs):
            for i in range(contact.runs[k, 0], contact.runs[k, 1]):
                at.p[i] *= factor


@kernel(inner=True, borrows=True)
def _change_set(p: FloatArray, gap: FloatArray, contact: ContactSet, shift: float, everywhere: bool) -> bool:
    """Let points under tension leave and overlapping ones join; return whether the pressure changed."""
    # The gap is known ``everywhere``, or near the contact.
    changed, runs, near, member = False, contact.runs, contact.near, contact.member
    for k in range(1 if everywhere else contact.counts[0].near):
        first, end = (0, p.size) if everywhere else (near[k, 0], near[k, 1])
        for i in range(first, end):
            if member[i] == 0.0 and gap[i] < shift:
                member[i] = 1.0
    for k in range(contact.counts[0].runs):
        for i in range(runs[k, 0], runs[k, 1]):
            if p[i] < 0.0:
                member[i] = p[i] = 0.0
                changed = True
    list_runs(contact)
    return changed


@kernel(reorder=True, inner=True, borrows=True)
def _scale_pressure(system: System, at: Iterate, contact: ContactSet, work: LoopArrays, shift: float) -> bool:
    """Scale the pressure to the least energy, and keep it for conjugacy; return whether this is done."""
    # It needs no transform. Under a given load the pressure cannot be scaled.
    now, counts = work.now[0], contact.counts[0]
    now.energy = 0.0
    if system.load_given or counts.points == 0:
        return False
    for k in range(counts.runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            work.pressure[i] = at.p[i]
    for k in range(counts.near):
        for i in range(contact.near[k, 0], contact.near[k, 1]):
            work.pressure_change[i] = at.gap[i] - system.gap0[i]
    energy = dot(contact, work.pressure, work.pressure_change)
    if not energy > 0.0:
        return False
    now.energy = energy
    factor = _along_residual(at, contact, work.pressure, shift) / energy
    add(contact.runs, counts.runs, factor, work.pressure, at.p)
    add(contact.near, counts.near, factor, work.pressure_change, at.gap)
    return True


@kernel(reorder=True, inner=True, borrows=True)
def _precondition(
    plans: Plans, system: System, at: Iterate, contact: ContactSet, work: LoopArrays, shift: float
) -> None:
    """Write z = kappa r, which would close the gaps of a contact without edges; two transforms."""
    work.z[:] = 0.0
    for k in range(contact.counts[0].runs):
        z = work.z[contact.runs[k, 0] : contact.runs[k, 1]]
        gap = at.gap[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(z.size):
            z[i] = shift - gap[i]
    apply_to(plans, system.stiffness, work.z, work.spectrum, work.spectrum, work.z)


@kernel(reorder=True, inner=True, borrows=True)
def _next_direction(
    system: System, at: Iterate, contact: ContactSet, work: LoopArrays, shift: float, memory: float
) -> tuple[float, float]:
    """Write the next direction of conjugate gradients; return r.z and r.d."""
    # ``memory`` is 1/(r.z) of the last iteration, or 0. Under a given load directions have no mean.
    z, d, now = work.z, work.direction, work.now[0]
    runs, count = contact.runs, contact.counts[0].runs
    if system.load_given:
        excess = mean(contact, z)
        for k in range(count):
            for i in range(runs[k, 0], runs[k, 1]):
                z[i] -= excess
    along = dot(contact, work.pressure_change, z) / now.energy if now.energy > 0.0 else 0.0
    product = _along_residual(at, contact, z, shift)
    memory *= product
    for k in range(count):
        for i in range(runs[k, 0], runs[k, 1]):
            d[i] = z[i] + memory * d[i]
    if along != 0.0:
        add(runs, count, -along, work.pressure, d)
    return product, _along_residual(at, contact, d, shift)


@kernel(inner=True, borrows=True)
def _step(at: Iterate, contact: ContactSet, work: LoopArrays, length: float) -> None:
    """Go along the direction; the gap follows in the contact and near it."""
    add(contact.runs, contact.counts[0].runs, length, work.direction, at.p)
    add(contact.near, contact.counts[0].near, length, work.change, at.gap)


@kernel(inner=True, borrows=True)
def _largest_on_line(contact: ContactSet, direction: FloatArray) -> float:
    """Largest entry of a direction on a line; zero on a surface in two directions."""
    largest = 0.0
    for k in range(contact.counts[0].runs if contact.reach[1] == contact.member.size else 0):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            largest = max(largest, abs(direction[i]))
    return largest


@kernel(reorder=True, inner=True, borrows=True)
def _along_residual(at: Iterate, contact: ContactSet, x: FloatArray, shift: float) -> float:
    """Sum of x (shift - gap) over the contact."""
    total = 0.0
    for k in range(contact.counts[0].runs):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        gaps = at.gap[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += (shift - gaps[i]) * xs[i]
    return total


@kernel(reorder=True, inner=True, borrows=True)
def _violations(
    system: System, at: Iterate, contact: ContactSet, work: LoopArrays, shift: float
) -> tuple[float, float, float]:
    """Range of the gaps in the contact, tension there, and overlap where the gap is known."""
    # Each in the residual's scales, which are set. Under a given load the punch is shifted first, so that the
    # gap in the contact is right in the mean.
    now, counts = work.now[0], contact.counts[0]
    if system.load_given and counts.points > 0:
        excess = mean(contact, at.gap) - shift
        now.mean += excess
        now.rigid_shift += excess
        if now.exact:
            for i in range(at.gap.size):
                at.gap[i] -= excess
        else:
            for k in range(counts.near):
                for i in range(contact.near[k, 0], contact.near[k, 1]):
                    at.gap[i] -= excess
    highest, deepest, lowest, largest = 0.0, 0.0, 0.0, 0.0
    for k in range(counts.runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            highest = max(highest, at.gap[i] - shift)
            deepest = min(deepest, at.gap[i] - shift)
            lowest = min(lowest, at.p[i])
            largest = max(largest, at.p[i])
    overlap, below = 0.0, now.depth_scale - max(now.mean, 0.0)
    if now.exact:
        overlap, below = _outside(system, at, contact, shift)
    else:
        for k in range(counts.near):
            for i in range(contact.near[k, 0], contact.near[k, 1]):
                overlap = min(overlap, at.gap[i] - shift + _FAR * contact.member[i])
                below = max(below, at.gap[i] - system.h[i])
    now.pressure_scale, now.depth_scale = scales(largest, below + max(now.mean, 0.0), system.floor)
    return (highest - deepest) / now.depth_scale, -lowest / now.pressure_scale, -overlap / now.depth_scale


@kernel(reorder=True, inner=True, borrows=True)
def _outside(system: System, at: Iterate, contact: ContactSet, shift: float) -> tuple[float, float]:
    """Overlap outside the contact, as a gap, and deepest point."""
    overlap, below = filled(LANES, 0.0), filled(LANES, -_FAR)
    for first in range(0, at.gap.size, LANES):
        gap, h = at.gap[first : first + LANES], system.h[first : first + LANES]
        member = contact.member[first : first + LANES]
        for i in range(gap.size):
            outside = gap[i] - shift + _FAR * member[i]
            overlap[i] = outside if outside < overlap[i] else overlap[i]
            depth = gap[i] - h[i]
            below[i] = depth if depth > below[i] else below[i]
    return minimum(overlap), maximum(below)
