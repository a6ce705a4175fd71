"""Against other codes, where they are installed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.simple_shapes import Parabola
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, HALFSPACE, ONE_STEP, run
from gfmdlayer.verification.theory import RADIUS, solver_error

_LOAD = 0.05


def tamaas(quick: bool) -> Iterator[Row]:
    """A viscoelastic halfspace under a load, by Tamaas and by backward Euler here.

    Frerot et al., J. Open Source Softw. 5 (2020) 2121. The same discrete problem and the same steps: what is
    left is the error of both solvers, Ginf/G0 of it with the history, which the depth feels less than the
    pressure does. Tamaas is asked for a tenth of our residual.
    """
    import tamaas as tm

    n, step, steps, tolerance = (2**9 if quick else 2**11), 0.1, 15, 1e-7
    tm.set_log_level(tm.LogLevel.error)
    tm.initialize(1)
    model = tm.ModelFactory.createModel(tm.model_type.basic_1d, [1.0], [n])
    model.E, model.nu = 3.0, 0.5  # relaxed
    surface = -Parabola(radius=RADIUS).heights(Grid((n,), (1.0,)))
    solver = tm.MaxwellViscoelastic(model, surface, tolerance / 100, step, [9.0], [1.0])
    solver.max_iter = 100_000
    depths = []
    for i in range(1, steps + 1):
        solver.solve(_LOAD * min(i * step, 1.0))
        depths.append(-float(model.displacement.mean()))
    trajectory = {"trajectory": {"control": "load", "load": _LOAD}}
    time = {"time": {"end": steps * step, "step": step, "integrator": "backward_euler"}}
    found = run(ALONE, trajectory, time, {"grid.points": n, "solver.tolerance": tolerance})
    ours = found["depth"][1:]
    off = float(np.abs(np.array(depths) - ours).max() / ours.max())
    bound = 1.1 * 10 * solver_error(tolerance, found.last("contact_area"), 1.0)
    yield Row(f"depth over the largest, n = {n}", 0.0, off, bound, f"Tamaas {tm.__version__}")
    touching = float((np.ravel(model.traction) > 0).mean())
    yield Row(f"atilde, n = {n}", touching, found.last("contact_area"), 2 / n, f"Tamaas {tm.__version__}")


def contact_mechanics(quick: bool) -> Iterator[Row]:
    """An elastic halfspace under a load, by ContactMechanics and here.

    The same discrete problem: twice the solver's error. Its depth is what the mean of the gap leaves of the
    mean height of the punch.
    """
    from importlib.metadata import version

    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Systems import NonSmoothContactSystem
    from SurfaceTopography import UniformLineScan

    n, tolerance = (2**9 if quick else 2**12), 1e-8
    heights = -Parabola(radius=RADIUS).heights(Grid((n,), (1.0,)))
    system = NonSmoothContactSystem(
        PeriodicFFTElasticHalfSpace((n,), 4.0, (1.0,)),
        UniformLineScan(heights, 1.0, periodic=True),
    )
    answer = system.minimize_proxy(external_force=_LOAD, pentol=tolerance * 1e-4)
    trajectory = {"trajectory": {"control": "load", "load": _LOAD}}
    found = run(HALFSPACE, ONE_STEP, trajectory, {"grid.points": n, "solver.tolerance": tolerance})
    source = f"ContactMechanics {version('ContactMechanics')}"
    depth = found.last("depth")
    gap = system.compute_gap(system.disp, answer.offset)
    theirs = float(-heights.mean() - gap.mean())
    bound = depth * 2 * solver_error(tolerance, found.last("contact_area"), 1.0)
    yield Row(f"depth/L, n = {n}", theirs, depth, bound, source)
    touching = float(system.compute_nb_contact_pts() / n)
    yield Row(f"atilde, n = {n}", touching, found.last("contact_area"), 2 / n, source)
