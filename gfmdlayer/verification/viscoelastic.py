"""Viscoelastic halfspaces over time against hereditary integrals of the elastic closed form."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, run
from gfmdlayer.verification.theory import (
    DEPTH,
    E_STAR,
    RADIUS,
    Ramp,
    parabola_depth,
    parabola_grid_error,
    parabola_half_width,
    parabola_pressure,
    relaxing,
    solver_error,
)

_TOLERANCE = 1e-8
_SPAN = 9.0  # Ginf - G0
_GLASSY = 10.0  # Ginf/G0
_SOURCE = "Lee and Radok (1960); Eq. (5)"


def depth_control(quick: bool) -> Iterator[Row]:
    """The paper's ramp on a viscoelastic halfspace, d = inf.

    While the contact does not shrink it is the elastic one of the same depth, and pbar(t) = int G(t - s)
    dF(depth(s)), F the elastic pbar at G = 1. Exponential steps put straight lines between the F of their
    ends: F is convex, and the integral of what lies between is dt^2/12 F' by the trapezoidal rule, so the
    pressure is too small by at most (Ginf - G0) dt^2/12 F'. Integrated by parts, an error of F itself, from
    the grid or the solver, counts (2 Ginf - G0)/G0 times at most.
    """
    n, step = (2**10, 0.05) if quick else (2**14, 0.0125)
    times = [0.1, 0.5, 1.0, 2.0]
    values = {"grid.points": n, "time.end": 2.0, "time.step": step, "solver.tolerance": _TOLERANCE}
    found = run(ALONE, values)
    ramp, at = Ramp.of_halfspace(), found.at("mean_pressure", times)
    for time, ptilde in zip(times, at, strict=True):
        done = min(time, 1.0)
        area, F = (float(np.interp(done, ramp.s, each)) for each in (ramp.area, ramp.F))
        growth = 1.5 * F / done  # d ln pbar/d ln depth is below 1.5
        off = _SPAN * step**2 / 12 * growth
        off += (2 * _GLASSY - 1) * (parabola_grid_error(n, area / 2) + solver_error(_TOLERANCE, area, F))
        exact = ramp.hereditary(time, relaxing)
        yield Row(f"ptilde, t = {time:g} tau, n = {n}", exact / 2, float(ptilde), off / 2, _SOURCE)
        touching = found.at("contact_area", [time]).item()
        yield Row(f"atilde, t = {time:g} tau, n = {n}", area, touching, 2 / n, _SOURCE)


def load_control(quick: bool) -> Iterator[Row]:
    """A viscoelastic halfspace that creeps under a load.

    The body is where the elastic one of modulus G0 is under F = int J(t - s) dpbar(s), J = 1/G0 - (1/G0 -
    1/Ginf) exp(-t G0/(Ginf tau)). The F of straight lines between the steps differs from that by at most
    (Ginf - G0)/G0 dt^2/12 F', F' below the rate of loading times J. From F on it is elastic: the depth is
    off by as much as F is, and the grid, times d(depth)/dF.
    """
    n, step, load = (2**10, 0.025, 0.05) if quick else (2**14, 0.0125, 0.05)
    times = [0.5, 1.0, 3.0]
    trajectory = {"trajectory": {"control": "load", "load": load}}
    values = {"grid.points": n, "time.end": 3.0, "time.step": step, "solver.tolerance": _TOLERANCE}
    found = run(ALONE, trajectory, values)
    for time in times:
        F = load * (_creep(time) - _creep(max(time - 1, 0)))
        a = float(np.arccos(np.exp(-2 * np.pi * RADIUS / E_STAR * F)) / np.pi)
        depth = found.at("depth", [time]).item()
        off = _SPAN * step**2 / 12 * load * _compliance(time)
        off += parabola_grid_error(n, a) + _GLASSY * solver_error(_TOLERANCE, 2 * a, F)
        slope = -2 / (np.pi * E_STAR) * float(np.log(np.sin(np.pi * a)))
        name = f"t = {time:g} tau, n = {n}"
        yield Row(f"depth/L, {name}", float(parabola_depth(a)), depth, off * slope, _SOURCE)
        touching = found.at("contact_area", [time]).item()
        yield Row(f"atilde, {name}", 2 * a, touching, 2 / n, _SOURCE)


def stored_energy(quick: bool) -> Iterator[Row]:
    """The elastic energy of the surface, and the work of the punch.

    Of an elastic halfspace both are int pbar d(depth) of the closed form. The ledger's work is summed over
    steps of equal depth: by Simpson's parabolas its error is below dt^2 of it, of the first steps where pbar
    has no Taylor series. What is stored has the grid's relative error and the solver's, of no more than the
    pressure.
    """
    n, steps = (2**10, 50) if quick else (2**14, 200)
    values = {"grid.points": n, "time.end": 1.0, "time.step": 1 / steps, "solver.tolerance": _TOLERANCE}
    found = run(ALONE, {"layer.material.Ginf": 1.0}, values)
    a = np.linspace(0, parabola_half_width(DEPTH), 20001)
    pressure, depth = parabola_pressure(a), parabola_depth(a)
    energy = float(((pressure[1:] + pressure[:-1]) / 2) @ np.diff(depth))
    off = parabola_grid_error(n, a[-1]) / pressure[-1] + solver_error(_TOLERANCE, float(2 * a[-1]), 1.0)
    off += 1e-8  # of the trapezoidal rule over 20000 steps
    source = "closed form, integrated"
    yield Row(f"stored energy, n = {n}", energy, found.last("stored"), energy * off, source)
    yield Row(f"work, n = {n}", energy, found.last("work"), energy * (off + steps**-2), source)


def _compliance(time: float) -> float:
    """J(t) of the paper's default material."""
    return 1 - 0.9 * float(np.exp(-time / 10))


def _creep(time: float) -> float:
    """Integral of J from 0."""
    return time + 9 * float(np.expm1(-time / 10))
