"""Projected conjugate gradients with nested grids, on random rough problems and beside the active set."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from gfmdlayer.case import Case
from gfmdlayer.config import Config
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import assess

TOLERANCE = 1e-6
SIZES = (64, 65, 67, 81, 90, 96, 97, 100, 101, 127, 128, 131, 144, 150, 180, 191, 192, 200, 243, 251, 256)


def problem_of(seed: int, sizes: tuple[int, ...] = SIZES) -> tuple[Case, Problem]:
    """A rough surface on a layer on a base up to a thousand times softer or stiffer, or on a halfspace.

    Loads go from one point in contact to full contact, or to the depths that these give.
    """
    draw = np.random.default_rng(seed)
    nx = int(draw.choice(sizes))
    ny = nx if draw.random() < 0.7 else int(draw.choice(sizes))
    contrast = 10.0 ** draw.uniform(-3, 3) if draw.random() < 0.8 else math.inf
    layered = draw.random() < 0.8 or math.isinf(contrast)
    config = Config(name="rough").with_values(
        {
            "grid": {"points": [nx, ny], "period": [1.0, float(draw.choice([1.0, ny / nx]))]},
            "layer.thickness": float(10 ** draw.uniform(-2.5, 0.5)) if layered else 0.0,
            "layer.poisson": float(draw.choice([0.5, 0.45, 0.3, 0.0])),
            "halfspace.shear_modulus": contrast,
            "punch": {
                "shape": "self_affine",
                "hurst": float(draw.uniform(0.3, 0.95)),
                "roll_off": float(draw.uniform(0.15, 0.6)),
                "short_cutoff": float(draw.uniform(4, 10) / min(nx, ny)),
                "rms_slope": float(10 ** draw.uniform(-3, 0)),
                "seed": seed,
            },
            "trajectory.control": "load",
            "trajectory.load": 1.0,
        }
    )
    case = Case(config)
    stiffness = np.array(case.integrator.terms(1e9)[0])
    given_load = draw.random() < 0.6
    mean, stiffness[0] = float(stiffness[0]), 0.0
    nothing = np.zeros(stiffness.size, complex)
    transforms = case.transforms
    full = transforms.backward(stiffness * transforms.forward(case.punch)) / case.punch.size
    load = -float(full.min()) * 10 ** draw.uniform(-6, 0.3)
    problem = Problem(stiffness, nothing, case.punch, load)
    if given_load:
        return case, problem
    # The depth to which the load presses; the layer's own mean stiffness then counts.
    found = solved(case, problem)
    stiffness = stiffness.copy()
    stiffness[0] = mean
    lift = load / mean if mean > 0 else 0.0
    obstacle = case.punch - found.displacement.mean() - lift
    return case, Problem(stiffness, nothing, obstacle)


def solved(case: Case, problem: Problem, start: Any = None) -> Solution:
    solver = NestedGradient(case.transforms, TOLERANCE, grid=case.grid)
    return solver.solve(problem, np.zeros(case.punch.size) if start is None else start)


def check(case: Case, problem: Problem) -> int:
    """Check the solution by its own pressure alone, in double precision; return its iterations."""
    found = solved(case, problem)
    assert found.converged
    size, kappa, p = case.punch.size, problem.stiffness, found.pressure
    spectrum = np.fft.rfft2(p.reshape(case.grid.shape)).ravel()
    u = np.zeros_like(spectrum)
    np.divide(-spectrum, kappa, out=u, where=kappa > 0)
    displacement = np.fft.irfft2(u.reshape(case.grid.spectral_shape), s=case.grid.shape).ravel()
    if problem.mean_pressure is not None:
        assert p.mean() == pytest.approx(problem.mean_pressure, rel=1e-12)
        displacement += found.displacement.mean()
    residual, *_ = assess(p, displacement, problem.obstacle, problem.residual_floor)
    depth = max(displacement.mean(), 0.0) - displacement.min()
    rounding = 1e-13 * (np.ptp(case.punch) + np.abs(displacement).max()) / depth * size**0.5
    assert residual <= TOLERANCE + rounding
    assert p.min() >= 0.0
    assert (found.displacement <= problem.obstacle).all()
    return found.iterations


@pytest.mark.parametrize("seed", range(8))
def test_random_rough_problems_are_solved(seed: int) -> None:
    check(*problem_of(seed, sizes=(64, 65, 67, 90, 128, 131)))
