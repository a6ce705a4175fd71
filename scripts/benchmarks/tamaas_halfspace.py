"""The viscoelastic halfspace by Tamaas, the mean gap prescribed by a secant on the load.

Tamaas (Frerot et al., J. Open Source Softw. 5 (2020) 2121) steps a generalised Maxwell halfspace by backward
Euler and solves each step for a given mean pressure by the method of Polonsky and Keer.  Its Young's modulus
is the relaxed one, its displacement counts into the body, its surface points at the body: minus the height of
the punch.  Where they touch, displacement and surface are equal, so the depth of the punch is minus the mean
of the displacement.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import tamaas

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Zener
from gfmdlayer.config import Config
from gfmdlayer.contact.prediction import DisplacementPrediction
from gfmdlayer.inputs import make_grid, make_punch, make_trajectory

VERSION = str(tamaas.__version__)

_GAP = 1e-6  # error of the depth, in units of it
_SECANTS = 30


@dataclass(frozen=True)
class Step:
    """One accepted step.

    Attributes
    ----------
    time : float
        In tau.
    depth : float
        The prescribed depth.
    load : float
        The mean pressure found for it.
    displacement : ndarray
        u, positive out of the body and of zero mean.
    solves, iterations : int
        Loads tried, and iterations of Polonsky and Keer in all of them.
    seconds : float
        The time that it took.
    """

    time: float
    depth: float
    load: float
    displacement: FloatArray
    solves: int
    iterations: int
    seconds: float


class _Iterations(tamaas.Functional):  # type: ignore[misc]
    """Adds nothing to the energy, and counts how often it is asked for its gradient: once an iteration."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def computeF(self, _primal: FloatArray, _dual: FloatArray) -> float:
        return 0.0

    def computeGradF(self, _primal: FloatArray, _gradient: FloatArray) -> None:
        self.count += 1


class TamaasHalfspace:
    """One run.

    Parameters
    ----------
    config : Config
        A Zener halfspace (its layer is infinitely thick) and a trajectory of the depth, on one axis.
    step : float
        Time step.
    tolerance : float
        Of Tamaas's own error.
    """

    def __init__(self, config: Config, step: float, tolerance: float) -> None:
        tamaas.set_log_level(tamaas.LogLevel.error)
        tamaas.initialize(1)
        material, poisson = config.layer.material, config.layer.poisson
        assert isinstance(material, Zener)
        self._model = tamaas.ModelFactory.createModel(
            tamaas.model_type.basic_1d, list(config.grid.period), list(config.grid.points)
        )
        self._model.E, self._model.nu = 2 * material.G0 * (1 + poisson), poisson
        self._surface = -make_punch(config, make_grid(config))
        self._solver = tamaas.MaxwellViscoelastic(
            self._model, self._surface, tolerance, step, [material.Ginf - material.G0], [material.tau]
        )
        self._solver.solve_should_update = False
        self._solver.max_iter = 100_000
        self._iterations = _Iterations()
        self._solver.addFunctionalTerm(self._iterations)
        self._trajectory, self._step = make_trajectory(config), step
        self._loads = DisplacementPrediction(1)
        self._loads.remember(0.0, np.zeros(1), np.zeros(1))
        self._count = 0

    def advance(self) -> Step:
        """Carry the run on by one step."""
        begun, before = time.perf_counter(), self._iterations.count
        self._count += 1
        now = self._count * self._step
        target = self._trajectory(now)
        load = float(self._loads.at(now)[0]) if self._count > 1 else self._model.E_star * target
        found, solves = self._depth(load), 1
        if self._count == 1:
            # The load is convex in the depth: the secant through the origin stays below it.
            self._stiffness = load / found
        while abs(found - target) > _GAP * target:
            if solves == _SECANTS:
                raise RuntimeError(f"Tamaas at t = {now:g}: no load for the depth {target:g}")
            tried, reached = load, found
            load = max(load + self._stiffness * (target - found), load / 2)  # which stays a pressure
            found, solves = self._depth(load), solves + 1
            self._stiffness = (load - tried) / (found - reached)
        self._solver.updateState()
        took = time.perf_counter() - begun
        self._loads.remember(now, np.array([load]), np.zeros(1))
        displacement = np.ravel(self._model.displacement)
        return Step(
            now,
            target,
            load,
            displacement.mean() - displacement,
            solves,
            self._iterations.count - before,
            took,
        )

    def _depth(self, load: float) -> float:
        """Solve for a mean pressure; return the depth that belongs to it."""
        self._solver.solve(load)
        return -float(self._model.displacement.mean())
