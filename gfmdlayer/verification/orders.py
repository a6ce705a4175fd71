"""Orders of convergence in time step, grid spacing and tolerances; the balance of energy."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from gfmdlayer.results.recording import Recording
from gfmdlayer.time_functions import Table
from gfmdlayer.verification.rows import Convergence, Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, HALFSPACE, ONE_STEP, RIGID, run
from gfmdlayer.verification.theory import (
    DEPTH,
    E_STAR,
    PARABOLA,
    RADIUS,
    parabola_depth,
    parabola_grid_error,
    parabola_half_width,
    parabola_pressure,
    solver_error,
)

_STEPS = (0.1, 0.05, 0.025)
_FINE: dict[str, object] = {
    "time.end": 3.0,
    "time.step": 0.1 / 32,
    "solver": {"method": "conjugate_gradient", "tolerance": 1e-9},
}
_SOLVERS = {"active_set": "active set", "conjugate_gradient": "conjugate gradients", "fire": "FIRE"}


def time_steps(quick: bool) -> Iterator[Row | Convergence]:
    """Error against the time step, and against the tolerance of adaptive steps, in whole runs.

    Backward differences are of first order, u linear over a step of second: here the largest error of ptilde
    up to 3 tau, against steps of tau/320 by conjugate gradients. The next term of either is a part dt/tau,
    twice that at most, of the first; over steps of 0.1 to 0.025 tau it tilts the line by less than 0.1, and
    the error of the fine steps, 1/64 of the last, by 0.01. Each adaptive step keeps its error below the
    tolerance of the largest pressure so far, and the history does not amplify it: the error of the run is
    below the tolerance and the error of both solvers.
    """
    n = 2**10 if quick else 2**14
    values = {"grid.points": n, "time.end": 3.0, "solver.tolerance": 1e-7}
    fine = run(values, _FINE)
    largest = float(fine["mean_pressure"].max())
    for integrator, name, order in (
        ("backward_euler", "backward Euler", 1),
        ("exponential", "exponential integrator", 2),
    ):
        runs = [run(values, {"time.step": step, "time.integrator": integrator}) for step in _STEPS]
        curve = Convergence(
            "step", name, _STEPS, tuple(_error(coarse, fine) / largest for coarse in runs), order
        )
        yield curve
        yield curve.row(0.11, f"{'Eq. (24)' if order == 1 else 'u linear in a step'}, n = {n}")
    tolerances, errors, residual = (1e-2, 1e-3, 1e-4, 1e-5), [], 1e-8
    solvers = 2 * 10 * solver_error(residual, float(fine["contact_area"].max()))
    for tolerance in tolerances:
        adaptive = {"time": {"end": 3.0, "step": "adaptive", "tolerance": tolerance}}
        errors.append(_error(run(values, adaptive, {"solver.tolerance": residual}), fine) / largest)
        name = f"error of ptilde, tolerance {tolerance:g}"
        yield Row(name, 0.0, errors[-1], tolerance + solvers, f"the tolerance, n = {n}")
    yield Convergence("tolerance", "adaptive steps", tolerances, tuple(errors), 1)


def papers_step(quick: bool) -> Iterator[Row]:
    """The paper's own time step.

    Where K = G(s) f(q), as on a rigid base, backward differences replace G(s) by G - (dt/2) s^2 G', and so
    change G(t - s) in the hereditary integral by |9 (dt/2) (1 - lag) exp(-lag)| < (dt/2) G(lag): the relative
    error of the pressure is below dt/(2 tau). The reference takes exponential steps of the same length, which
    are of second order.
    """
    n = 2**11 if quick else 2**14
    values = {"grid.points": n, "time.end": 3.0, "time.step": 0.005, "solver.tolerance": 1e-7}
    exact = run(values, RIGID)["mean_pressure"][1:]
    paper = run(values, RIGID, {"time.integrator": "backward_euler"})["mean_pressure"][1:]
    later = slice(round(0.1 / 0.005), None)  # before that second-order terms count as well
    off = float(np.abs(paper / exact - 1)[later].max())
    yield Row(f"error of ptilde, relative, n = {n}", 0.0, off, 0.0025, "Eqs. (5), (28)")


def grid_spacing(quick: bool) -> Iterator[Row | Convergence]:
    """Error against the number of points, on an elastic halfspace.

    The error of the mean pressure is C (D/L)^2 times a known function of the contact, C a function of the
    place of the edge between two points; the largest over eight places falls as n^-2, for the places are the
    same on every grid. The next term is a part D/a of that, twice at most: with 23 points in a, and twice as
    many on each next grid, it tilts the line by less than 0.05. The edge lies within a cell, so the error of
    the area is below two cells, as n^-1; between half of that and all of it, it tilts the line by
    ln 2/ln 16 = 0.25.
    """
    grids = [2**k for k in (range(9, 12) if quick else range(9, 17))]
    tolerance = 1e-10
    solver = {"method": "conjugate_gradient", "tolerance": tolerance}
    errors = np.empty((3, len(grids), 8))  # of pressure, of area, of pressure over its bound
    for i, n in enumerate(grids):
        for j, place in enumerate(np.arange(8) / 8):
            a = (round(0.045 * n) + place) / n
            depth, p = float(parabola_depth(a)), float(parabola_pressure(a))
            values = {"grid.points": n, "trajectory.depth": depth, "solver": solver}
            computed = run(HALFSPACE, ONE_STEP, values)
            off = abs(2 * computed.last("mean_pressure") - p)
            bound = parabola_grid_error(n, a) + solver_error(tolerance, 2 * a, p)
            errors[:, i, j] = off / p, abs(computed.last("contact_area") - 2 * a), off / bound
    pressure, area, parts = errors.max(axis=2)
    source = f"{PARABOLA}; E* = {E_STAR:g}, R = {RADIUS:g}"
    yield Row("error of ptilde over its bound", 0.0, float(parts.max()), 1.0, source)
    cells = float((area * grids / 2).max())
    yield Row("error of either edge, in cells", 0.0, cells, 1.0, source)
    for name, of_grids, slope, tilt in (
        ("error of ptilde", pressure, -2, 0.05),
        ("error of atilde", area, -1, 0.25),
    ):
        curve = Convergence("points", name, tuple(map(float, grids)), tuple(of_grids.tolist()), slope)
        yield curve
        yield curve.row(tilt, f"n = {grids[0]} to {grids[-1]}")


def solver_tolerance(quick: bool) -> Iterator[Row | Convergence]:
    """Error against the tolerance of the solvers.

    At a residual r the error of the mean pressure is r (p_max + depth d pbar/d(depth)) at most, and Ginf/G0
    of that in a run with a history. A method stops between a tenth of the tolerance and all of it: a factor
    of three either way about the line, which over five decades tilts it by 0.26.
    """
    n = 2**10 if quick else 2**13
    values = {"grid.points": n, "time.end": 1.0, "time.step": 0.1}
    exact = run(values, {"solver": {"method": "conjugate_gradient", "tolerance": 1e-11}})
    p, a = exact["mean_pressure"][1:], exact["contact_area"][1:]
    tolerances = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
    for method, name in _SOLVERS.items():
        errors, parts = [], []
        for tolerance in tolerances:
            pressure = run(values, {"solver": {"method": method, "tolerance": tolerance}})["mean_pressure"][
                1:
            ]
            errors.append(float(np.sqrt(np.mean((pressure - p) ** 2)) / p.max()))
            bound = [10 * solver_error(tolerance, *each) for each in zip(a, p, strict=True)]
            parts.append(float((np.abs(pressure - p) / bound).max()))
        curve = Convergence("tolerance", name, tolerances, tuple(errors), 1)
        yield curve
        yield curve.row(0.26, f"residual, n = {n}")
        yield Row(f"{name}: error of ptilde over its bound", 0.0, max(parts), 1.0, "Betti")


def _error(computed: Recording, exact: Recording) -> float:
    """Largest error of ptilde at the ends of the steps; splines between breakpoints join the fine steps."""
    largest = 0.0
    for begin, end in ((0.0, 1.0), (1.0, 3.0)):
        known = (exact["time"] >= begin - 1e-9) & (exact["time"] <= end + 1e-9)
        steps = (computed["time"] >= max(begin - 1e-9, 0.1)) & (computed["time"] <= end + 1e-9)
        curve = CubicSpline(exact["time"][known], exact["mean_pressure"][known])
        off = np.abs(computed["mean_pressure"][steps] - curve(computed["time"][steps]))
        largest = max(largest, float(off.max()))
    return largest


# Energy: stored energy of an elastic halfspace, and the balance work = stored + dissipated.

_BALANCE_STEPS = (0.05, 0.025, 0.0125)
FINE_STEPS = (0.0125, 0.00625, 0.003125)
_CYCLE = Table(np.array([0.0, 1.0, 1.5, 2.5, 3.0]), np.array([0.0, 0.01, 0.002, 0.01, 0.01]))


def stored_energy(quick: bool) -> Iterator[Row]:
    """The elastic energy of the surface, and the work of the punch.

    On an elastic halfspace both are int pbar d(depth) of the closed form. The work is a sum over steps of
    equal depth by Simpson's parabolas; its relative error is below dt^2 and comes from the first steps, where
    pbar has no Taylor series. The stored energy has the relative errors of grid and solver, which are no
    larger than those of the pressure.
    """
    n, steps = (2**10, 50) if quick else (2**14, 200)
    values = {"grid.points": n, "time.end": 1.0, "time.step": 1 / steps, "solver.tolerance": 1e-8}
    computed = run(ALONE, ELASTIC, values)
    a = np.linspace(0, parabola_half_width(DEPTH), 20001)
    pressure, depth = parabola_pressure(a), parabola_depth(a)
    energy = float(((pressure[1:] + pressure[:-1]) / 2) @ np.diff(depth))
    off = parabola_grid_error(n, a[-1]) / pressure[-1] + solver_error(1e-8, float(2 * a[-1]))
    off += 1e-8  # of the trapezoidal rule over 20000 steps
    source = "closed form, integrated"
    yield Row(f"stored energy, n = {n}", energy, computed.last("stored"), energy * off, source)
    yield Row(f"work, n = {n}", energy, computed.last("work"), energy * (off + steps**-2), source)


def balance(quick: bool) -> Iterator[Row | Convergence]:
    """The residual of the energy balance of the paper's default case, relative to the work.

    Over a step of backward Euler each mode loses w |du|^2/2 besides its heat, dt/(2 tau) of the heat at most:
    first order. With u linear over a step the heat of the exponential integrator is exact, and the residual
    is the quadrature of the work along kinks of dp/dt, of second order. Its third order is larger at long
    steps, so that the order shows at fine ones. The contact grows by whole grid points, which scatters
    either line by a tenth; the next terms tilt it by as much.
    """
    n = 2**11 if quick else 2**14
    values = {"grid.points": n, "time.end": 2.0, "solver.tolerance": 1e-9}
    source = f"first law, n = {n}"
    for integrator, order, steps in (("backward_euler", 1, _BALANCE_STEPS), ("exponential", 2, FINE_STEPS)):
        runs = [run(values, {"time.integrator": integrator, "time.step": step}) for step in steps]
        residuals = tuple(map(residual, runs))
        curve = Convergence(
            "step", f"energy balance, {integrator.replace('_e', ' E')}", steps, residuals, order
        )
        yield curve
        yield curve.row(0.2, source)
        if order == 1:
            bound = steps[-1] / 2 * float((runs[-1]["dissipated"] / runs[-1]["work"].max()).max())
            yield Row(f"residual, dt = {steps[-1]} tau", 0.0, residuals[-1], bound, source)


def cycle(quick: bool) -> Iterator[Row]:
    """A punch that is pressed in, drawn out and pressed in again.

    The dissipated heat never decreases and the stored energy is never negative, to the last bit, since both
    are sums of squares. An elastic body returns all the work: at the same depth on the way in and out the
    work is the same within its quadrature, of second order in the step over the length of a ramp.
    """
    n, step = (2**10, 0.025) if quick else (2**13, 0.0125)
    values = {"grid.points": n, "time.end": 3.0, "time.step": step, "solver.tolerance": 1e-7}
    relaxing, elastic = (run(values, body, trajectory=_CYCLE) for body in ({}, ELASTIC))
    lost = max(0.0, float(-np.diff(relaxing["dissipated"]).min()))
    yield Row("decrease of the heat", 0.0, lost, 0.0, "second law")
    yield Row("stored energy below zero", 0.0, max(0.0, float(-relaxing["stored"].min())), 0.0, "second law")
    first, out, second = elastic.at("work", [0.6, 1.25, 2.0])  # 0.006 L deep each time
    bound = (step / 0.5) ** 2
    yield Row("elastic: work out/in", 1.0, float(out / first), bound, "first law")
    yield Row("elastic: second work in/first", 1.0, float(second / first), bound, "first law")
    yield Row("elastic: heat", 0.0, float(elastic["dissipated"].max()), 0.0, "no branch, no heat")


def residual(computed: Recording) -> float:
    """Return the largest residual of the energy balance over the largest work."""
    return float(np.abs(computed["energy_residual"]).max() / computed["work"].max())
