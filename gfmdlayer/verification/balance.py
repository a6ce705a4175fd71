"""The energy balance: work = stored + dissipated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gfmdlayer.verification.rows import Curve, Row
from gfmdlayer.verification.runs import Recording, run, table

_STEPS = (0.05, 0.025, 0.0125)
_CYCLE = [(0.0, 0.0), (1.0, 0.01), (1.5, 0.002), (2.5, 0.01), (3.0, 0.01)]


def closing(quick: bool) -> Iterator[Row | Curve]:
    """What the balance of the paper's default case lacks, as a part of the work.

    Over a step of backward Euler each mode loses w |du|^2/2 besides its heat, dt/(2 tau) of the heat at most:
    first order. With u linear over a step the heat of the exponential integrator is exact, and what is left
    is the quadrature of the work, of second order. The contact grows by whole grid points, which scatters
    either line by a tenth; the next terms tilt it by as much.
    """
    n = 2**11 if quick else 2**14
    values = {"grid.points": n, "time.end": 2.0, "solver.tolerance": 1e-7}
    for integrator, order in (("backward_euler", 1), ("exponential", 2)):
        runs = [run(values, {"time.integrator": integrator, "time.step": step}) for step in _STEPS]
        lacks = [_lack(each) for each in runs]
        curve = Curve(
            "step", f"energy balance, {integrator.replace('_e', ' E')}", _STEPS, tuple(lacks), order
        )
        yield curve
        yield curve.row(0.2, f"first law, n = {n}")
        if order == 1:
            allowed = _STEPS[-1] / 2 * float((runs[-1]["dissipated"] / runs[-1]["work"].max()).max())
            yield Row(f"lack, dt = {_STEPS[-1]} tau", 0.0, lacks[-1], allowed, f"first law, n = {n}")


def cycle(quick: bool) -> Iterator[Row]:
    """A punch that goes in, out and in again.

    Heat only grows, and no spring stores less than nothing: to the last bit, for both are sums of squares.
    An elastic body gives all the work back: at the same depth on the way in and out the work is the same but
    for its quadrature, of the second order of the step over the length of a ramp.
    """
    n, step = (2**10, 0.025) if quick else (2**13, 0.0125)
    values = {"grid.points": n, "time.end": 3.0, "time.step": step, "solver.tolerance": 1e-7}
    with table(_CYCLE) as trajectory:
        found = run(values, trajectory)
        elastic = run(values, trajectory, {"layer.material.Ginf": 1.0})
    lost = max(0.0, float(-np.diff(found["dissipated"]).min()))
    yield Row("heat that comes back", 0.0, lost, 0.0, "second law")
    yield Row("stored energy below zero", 0.0, max(0.0, float(-found["stored"].min())), 0.0, "second law")
    there, out, again = elastic.at("work", [0.6, 1.25, 2.0])  # 0.006 L deep each time
    yield Row("elastic: work out/in", 1.0, float(out / there), (step / 0.5) ** 2, "first law")
    yield Row("elastic: work in again/in", 1.0, float(again / there), (step / 0.5) ** 2, "first law")
    yield Row("elastic: heat", 0.0, float(elastic["dissipated"].max()), 0.0, "no branch, no heat")


def _lack(found: Recording) -> float:
    return float(np.abs(found["energy_residual"]).max() / found["work"].max())
