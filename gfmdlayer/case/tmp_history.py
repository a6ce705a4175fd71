from __future__ import annotations
import math
from typing import NamedTuple, Any
import numpy as np
from gfmdlayer.history.modes import (
    BranchModes,
    LocalModes,
    Factors,
    StepTerms,
    intercepts,
    advance as advance_modes,
)
from gfmdlayer.history.errors import _stress_norm, _displacement_error
from gfmdlayer.grid.sums import _products
from gfmdlayer.kernels import kernel
import numba as nb

CONTROL = np.dtype(
    [
        ("has_velocity", "?"),
        ("has_motion", "?"),
        ("step", "f8"),
        ("last_step", "f8"),
        ("stored", "f8"),
        ("dissipated", "f8"),
    ]
)
STEP = np.dtype(
    [(n, "f8") for n in ("time", "next_step", "largest_response", "largest_depth", "depth")]
    + [(n, "i8") for n in ("next_stop", "after_breakpoint", "since", "fixed")]
)


class HistoryArrays(NamedTuple):
    branches: Any
    local: Any
    springs: Any
    times: Any
    relaxed: Any
    factors: Any
    held: Any
    stiffness: Any
    u: Any
    velocity: Any
    curvature: Any
    motion: Any
    force: Any
    missing: Any
    gains: Any
    weights: Any
    weights_twice: Any
    control: Any


class ControlArrays(NamedTuple):
    stops: Any
    marks: Any
    tolerance: float
    shortest: float
    now: Any


class Instant_(NamedTuple):
    time: float
    step: float
    snapshot: bool
    breakpoint: bool
    fresh: bool
    lands: bool


@nb.njit(inline="always")
def numbers(x):
    return x.view(np.float64)


@kernel(inner=True, borrows=True)
def rows_of(f, first, end):
    return Factors(f[0][first:end], f[1][first:end], f[2][first:end], f[3][first:end], f[4][first:end],
                   f[5][first:end], f[6][first:end])  # fmt: skip


@kernel(inner=True, borrows=True)
def exponential(step, times, f):
    # `history.modes.exponential` without a new array
    for i in range(times.size):
        some = step / times[i]
        decay, gain, lead = math.exp(-some), 1.0, 0.5
        if some > 0.0:
            gain, lead = -math.expm1(-some) / some, math.tanh(some / 2) / some
        if some < 0.1:
            square = some * some
            remainder = some * (1 / 12 + square * (-1 / 120 + square * (17 / 20160 - square * 31 / 362880)))
            curvature_gain = (1 + decay) * remainder
            higher = 11 / 630 + some * (-1 / 120 + some * (283 / 90720 - some * 289 / 302400))
            curvature_loss = some * (1 / 30 + some * (-1 / 36 + some * higher))
        else:
            remainder = (some - 2 * math.tanh(some / 2)) / some**2
            curvature_gain = (1 + decay) * remainder
            curvature_loss = 1 / (3 * some) - curvature_gain * ((some + 2) / some**2 + curvature_gain / 2)
        f[0, i], f[1, i], f[2, i], f[3, i] = decay, gain, -math.expm1(-2 * some) / 2, lead
        f[4, i], f[5, i], f[6, i] = remainder, curvature_gain, curvature_loss


@nb.njit(fastmath={"contract"})
def dot(x, y):
    total = 0.0
    for i in range(x.size):
        total += x[i] * y[i]
    return total


@kernel(inner=True, borrows=True)
def terms(body, step, b):
    now = body.control[0]
    branches, local, count, held = body.branches, body.local, body.branches.moduli.size, body.held
    if step != now.step:
        now.step = step
        exponential(step, body.times, body.factors)
        total = dot(branches.moduli, body.factors[1])
        for j in range(count):
            held.branch_decay[j] = branches.moduli[j] * body.factors[0, j]
        for k in range(body.relaxed.size):
            held.gain[2 * k] = branches.shape[2 * k] * total
        for i in range(local.position.size):
            held.gain[2 * local.position[i]] += local.weights[i] * body.factors[1, count + i]
            held.local_decay[i] = local.weights[i] * body.factors[0, count + i]
        for k in range(body.relaxed.size):
            held.gain[2 * k + 1] = held.gain[2 * k]
            body.stiffness[k] = body.relaxed[k] + held.gain[2 * k]
    intercepts(branches, local, held, numbers(body.u), numbers(b))


@kernel(inner=True, reorder=True, borrows=True)
def bend(ratio, step, new, u, velocity, found):
    for i in range(u.size):
        found[i] = ratio * (new[i] - u[i] - step * velocity[i])


@kernel(inner=True, reorder=True, borrows=True)
def stresses(gain, shape, index, gains, stiffness, u, b, curvature, force, missing):
    for k in range(stiffness.size):
        force[2 * k] = stiffness[k] * u[2 * k] - b[2 * k]
        force[2 * k + 1] = stiffness[k] * u[2 * k + 1] - b[2 * k + 1]
    for i in range(missing.size):
        missing[i] = gain * shape[i] * curvature[i]
    for i in range(index.size):
        for k in range(2 * index[i], 2 * index[i] + 2):
            missing[k] += gains[i] * curvature[k]


@kernel(inner=True, borrows=True)
def error(body, spectrum, bb, moving, deep):
    now = body.control[0]
    new, b, u = numbers(spectrum), numbers(bb), numbers(body.u)
    count, curvature, gains, ratio = body.branches.moduli.size, body.curvature, body.gains, 0.0
    if now.has_velocity:
        bend(now.step / (now.step + now.last_step), now.step, new, u, body.velocity, curvature)
    else:
        for i in range(new.size):
            curvature[i] = 0.25 * (new[i] - u[i])
    total = dot(body.branches.moduli, body.factors[5])
    for i in range(gains.size):
        gains[i] = body.local.weights[i] * body.factors[5, count + i]
    stresses(total, body.branches.shape, body.local.position, gains, body.stiffness, new, b, curvature, body.force,
             body.missing)  # fmt: skip
    if moving:
        now.has_motion = True
        for k in range(new.size):
            body.motion[k] = new[k] - u[k]
    norm = _stress_norm(body.weights, body.stiffness, new)
    for part in range(2):
        if deep if part == 0 else now.has_motion:
            v = new if part == 0 else body.motion
            work, error_work, squares = _products(body.weights_twice, v, body.force, body.missing)
            if work * work > 1e-10**2 * squares * norm and abs(error_work / work) > abs(ratio):
                ratio = error_work / work
    square = _displacement_error(body.weights, body.stiffness, body.missing, ratio, body.force)
    return abs(ratio), math.sqrt(square)


@kernel(inner=True, borrows=True)
def advance(body, spectrum, controlled):
    now = body.control[0]
    new, u = numbers(spectrum), numbers(body.u)
    count, size, known = body.branches.moduli.size, body.times.size, new.size if now.has_velocity else 0
    if now.step > 0:
        inverse = 1 / now.step
        for k in range(new.size):
            body.velocity[k] = (new[k] - u[k]) * inverse
    twice, heat = advance_modes(
        body.branches, rows_of(body.factors, 0, count), body.local, rows_of(body.factors, count, size), body.springs,
        u, new, body.curvature[:known])  # fmt: skip
    now.stored = twice / 2
    now.dissipated += heat
    if now.step > 0:
        now.has_velocity, now.last_step = True, now.step


@kernel(inner=True, borrows=True)
def is_over(control):
    return control.now[0].next_stop == control.stops.size


@kernel(inner=True, borrows=True)
def next_instant(control):
    now = control.now[0]
    fresh = now.after_breakpoint != 0
    if fresh:
        now.next_step = 0.3 * now.next_step
        now.since, now.after_breakpoint = 0, 0
    stop, mark = control.stops[now.next_stop], control.marks[now.next_stop]
    left = stop - now.time
    step = left if now.next_step >= left else min(now.next_step, left / 2)
    lands = step == left
    time = stop if lands else now.time + step
    return Instant_(time, step, lands and mark & 2 != 0, lands and mark & 1 != 0, fresh, lands)


@kernel(inner=True, borrows=True)
def accepts(control, history, surface_spectrum, b, instant, depth, response):
    now = control.now[0]
    response_scale, depth_scale = max(now.largest_response, abs(response)), max(now.largest_depth, depth)
    accepted, step = True, instant.step
    if step == 0:
        pressed = False
        for k in range(surface_spectrum.size):
            pressed = pressed or (depth_scale > 0 and surface_spectrum[k] != 0.0)
        now.next_step = control.shortest * 1.0 * (1e-6 if pressed else 30.0 * control.tolerance)
    else:
        relative, off = error(history, surface_spectrum, b, depth != now.depth, depth >= 0.01 * depth_scale)
        worst = max(relative * abs(response) / response_scale if response_scale > 0 else 0.0,
                    off / depth_scale if depth_scale > 0 else 0.0)  # fmt: skip
        accepted = worst <= control.tolerance
        if not accepted and step <= 4 * 2.220446049250313e-16 * instant.time:
            accepted, worst = True, control.tolerance
        factor = (0.9 * control.tolerance / max(worst, 1e-300)) ** (1 / 3)
        if accepted:
            growth = 4.0 if now.since < 3 else 2.0
            now.next_step = max(min(now.next_step, factor * step), min(growth, factor) * step)
            now.since += 1
        else:
            now.next_step = min(max(factor, 0.2), 0.8) * step
    if accepted:
        now.largest_response, now.largest_depth, now.depth, now.time = (
            response_scale,
            depth_scale,
            depth,
            instant.time,
        )
        now.after_breakpoint = 1 if instant.breakpoint else 0
        now.next_stop += instant.lands
    return accepted


