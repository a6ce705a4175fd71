"""The energy: stored energy of an elastic halfspace, and the balance work = stored + dissipated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gfmdlayer.time_functions import Table
from gfmdlayer.verification.rows import Curve, Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, Recording, run
from gfmdlayer.verification.theory import (
    DEPTH,
    parabola_depth,
    parabola_grid_error,
    parabola_half_width,
    parabola_pressure,
    solver_error,
)

_STEPS = (0.05, 0.025, 0.0125)
_CYCLE = Table(np.array([0.0, 1.0, 1.5, 2.5, 3.0]), np.array([0.0, 0.01, 0.002, 0.01, 0.01]))


def stored_energy(quick: bool) -> Iterator[Row]:
    """The elastic energy of the surface, and the work of the punch.

    On an elastic halfspace both are int pbar d(depth) of the closed form. The work is summed over steps of
    equal depth: by Simpson's parabolas its error is below dt^2 of it, from the first steps, where pbar has no
    Taylor series. The stored energy has the grid's relative error, and the solver's, which is no larger than
    that of the pressure.
    """
    n, steps = (2**10, 50) if quick else (2**14, 200)
    values = {"grid.points": n, "time.end": 1.0, "time.step": 1 / steps, "solver.tolerance": 1e-8}
    found = run(ALONE, ELASTIC, values)
    a = np.linspace(0, parabola_half_width(DEPTH), 20001)
    pressure, depth = parabola_pressure(a), parabola_depth(a)
    energy = float(((pressure[1:] + pressure[:-1]) / 2) @ np.diff(depth))
    off = parabola_grid_error(n, a[-1]) / pressure[-1] + solver_error(1e-8, float(2 * a[-1]))
    off += 1e-8  # of the trapezoidal rule over 20000 steps
    source = "closed form, integrated"
    yield Row(f"stored energy, n = {n}", energy, found.last("stored"), energy * off, source)
    yield Row(f"work, n = {n}", energy, found.last("work"), energy * (off + steps**-2), source)


def balance(quick: bool) -> Iterator[Row | Curve]:
    """The residual of the energy balance of the paper's default case, relative to the work.

    Over a step of backward Euler each mode loses w |du|^2/2 besides its heat, dt/(2 tau) of the heat at most:
    first order. With u linear over a step the heat of the exponential integrator is exact, and the residual
    is the quadrature of the work, of second order. The contact grows by whole grid points, which scatters
    either line by a tenth; the next terms tilt it by as much.
    """
    n = 2**11 if quick else 2**14
    values = {"grid.points": n, "time.end": 2.0, "solver.tolerance": 1e-7}
    source = f"first law, n = {n}"
    for integrator, order in (("backward_euler", 1), ("exponential", 2)):
        runs = [run(values, {"time.integrator": integrator, "time.step": step}) for step in _STEPS]
        residuals = tuple(map(_residual, runs))
        curve = Curve("step", f"energy balance, {integrator.replace('_e', ' E')}", _STEPS, residuals, order)
        yield curve
        yield curve.row(0.2, source)
        if order == 1:
            bound = _STEPS[-1] / 2 * float((runs[-1]["dissipated"] / runs[-1]["work"].max()).max())
            yield Row(f"residual, dt = {_STEPS[-1]} tau", 0.0, residuals[-1], bound, source)


def cycle(quick: bool) -> Iterator[Row]:
    """A punch that is pressed in, drawn out and pressed in again.

    The dissipated heat only grows, and the stored energy is never negative: to the last bit, for both are
    sums of squares. An elastic body returns all the work: at the same depth on the way in and out the work is
    the same but for its quadrature, of the second order of the step over the length of a ramp.
    """
    n, step = (2**10, 0.025) if quick else (2**13, 0.0125)
    values = {"grid.points": n, "time.end": 3.0, "time.step": step, "solver.tolerance": 1e-7}
    found, elastic = (run(values, body, trajectory=_CYCLE) for body in ({}, ELASTIC))
    lost = max(0.0, float(-np.diff(found["dissipated"]).min()))
    yield Row("decrease of the heat", 0.0, lost, 0.0, "second law")
    yield Row("stored energy below zero", 0.0, max(0.0, float(-found["stored"].min())), 0.0, "second law")
    first, out, second = elastic.at("work", [0.6, 1.25, 2.0])  # 0.006 L deep each time
    bound = (step / 0.5) ** 2
    yield Row("elastic: work out/in", 1.0, float(out / first), bound, "first law")
    yield Row("elastic: second work in/first", 1.0, float(second / first), bound, "first law")
    yield Row("elastic: heat", 0.0, float(elastic["dissipated"].max()), 0.0, "no branch, no heat")


def _residual(found: Recording) -> float:
    return float(np.abs(found["energy_residual"]).max() / found["work"].max())
