"""Comparison with other codes, where they are installed."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.simple_shapes import Parabola
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, HALFSPACE, ONE_STEP, run
from gfmdlayer.verification.theory import RADIUS, solver_error

_LOAD = 0.05
_TRAJECTORY = {"trajectory": {"control": "load", "load": _LOAD}}


class TamaasHalfspace:
    """The paper's default material as a halfspace of period 1, in the steps of Tamaas.

    Tamaas steps a generalised Maxwell halfspace by backward Euler and solves each step for a mean pressure by
    the method of Polonsky and Keer. Its Young's modulus is the relaxed one, its displacement counts into the
    body, and its surface is minus the height of the punch.
    """

    def __init__(self, heights: FloatArray, step: float, tolerance: float) -> None:
        import tamaas

        tamaas.set_log_level(tamaas.LogLevel.error)
        tamaas.initialize(1)
        self.version = str(tamaas.__version__)
        self._model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_1d, [1.0], [heights.size])
        self._model.E, self._model.nu = 3.0, 0.5
        self._surface = -heights  # which the solver refers to
        self._solver = tamaas.MaxwellViscoelastic(self._model, self._surface, tolerance, step, [9.0], [1.0])
        self._solver.max_iter = 100_000

    def press(self, load: float) -> float:
        """Take a time step to a mean pressure and return the depth."""
        self._solver.solve(load)
        return -float(self._model.displacement.mean())

    @property
    def displacement(self) -> FloatArray:
        """Displacement of the surface, positive upward, of zero mean."""
        into_body = np.ravel(self._model.displacement)
        return np.asarray(into_body.mean() - into_body)

    @property
    def contact_area(self) -> float:
        """Fraction of the points in contact."""
        return float((np.ravel(self._model.traction) > 0).mean())


def tamaas(quick: bool) -> Iterator[Row]:
    """A viscoelastic halfspace under a load, by Tamaas and by backward Euler here.

    Frerot et al., J. Open Source Softw. 5 (2020) 2121. The same discrete problem and the same steps: the
    difference is the error of both solvers, Ginf/G0 of it with the history, and smaller in the depth than in
    the pressure. Tamaas is asked for a tenth of our residual.
    """
    n, step, steps, tolerance = (2**9 if quick else 2**11), 0.1, 15, 1e-7
    peer = TamaasHalfspace(Parabola(radius=RADIUS).heights(Grid((n,), (1.0,))), step, tolerance / 100)
    depths = [peer.press(_LOAD * min(i * step, 1.0)) for i in range(1, steps + 1)]
    time = {"time": {"end": steps * step, "step": step, "integrator": "backward_euler"}}
    found = run(ALONE, _TRAJECTORY, time, {"grid.points": n, "solver.tolerance": tolerance})
    area, depth = found.last("contact_area"), found["depth"][1:]
    source = f"Tamaas {peer.version}"
    off = float(np.abs(np.array(depths) - depth).max() / depth.max())
    yield Row(f"depth over the largest, n = {n}", 0.0, off, 1.1 * 10 * solver_error(tolerance, area), source)
    yield Row(f"atilde, n = {n}", peer.contact_area, area, 2 / n, source)


def contact_mechanics(quick: bool) -> Iterator[Row]:
    """An elastic halfspace under a load, by ContactMechanics and here.

    The same discrete problem: twice the solver's error. The depth in ContactMechanics is the mean height of
    the punch less the mean gap.
    """
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Systems import NonSmoothContactSystem
    from SurfaceTopography import UniformLineScan

    n, tolerance = (2**9 if quick else 2**12), 1e-8
    heights = -Parabola(radius=RADIUS).heights(Grid((n,), (1.0,)))
    system = NonSmoothContactSystem(
        PeriodicFFTElasticHalfSpace((n,), 4.0, (1.0,)), UniformLineScan(heights, 1.0, periodic=True)
    )
    answer = system.minimize_proxy(external_force=_LOAD, pentol=tolerance * 1e-4)
    peer_depth = float(-heights.mean() - system.compute_gap(system.disp, answer.offset).mean())
    peer_area = float(system.compute_nb_contact_pts() / n)
    found = run(HALFSPACE, ONE_STEP, _TRAJECTORY, {"grid.points": n, "solver.tolerance": tolerance})
    area, depth = found.last("contact_area"), found.last("depth")
    source = f"ContactMechanics {version('ContactMechanics')}"
    yield Row(f"depth/L, n = {n}", peer_depth, depth, depth * 2 * solver_error(tolerance, area), source)
    yield Row(f"atilde, n = {n}", peer_area, area, 2 / n, source)
