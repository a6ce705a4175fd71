"""Interfaces that attract: the solvers find a minimum, and the one to which the state before leads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.adhesion import Dugdale, Exponential, LennardJones
from gfmdlayer.interface.electrostatic import Electrostatic
from gfmdlayer.interface.law import HARD_WALL, InterfaceLaw, total

Floats = NDArray[np.float64]

LINE, SURFACE = (32,), (6, 6)
TRANSFORMS = {shape: Transforms(shape) for shape in (LINE, SURFACE)}


def problem(
    kappa: Floats, h: Floats, law: InterfaceLaw, load: float | None = None, b: Floats | None = None
) -> Problem:
    """Contact problem on a line, or with the transform of an intercept."""
    intercept = np.zeros(kappa.size, complex) if b is None else b
    return Problem(kappa, intercept.astype(complex), h, load, interface=law)


def at_rest(size: int) -> Floats:
    """Gap before the first step."""
    return np.full(size, np.inf)


def dense(kappa: Floats, shape: tuple[int, ...]) -> Floats:
    """K as a matrix over the points."""
    spectral = (*shape[:-1], shape[-1] // 2 + 1)
    unit = np.eye(int(np.prod(shape))).reshape(-1, *shape)
    axes = tuple(range(1, unit.ndim))
    rows = np.fft.irfftn(kappa.reshape(spectral) * np.fft.rfftn(unit, axes=axes), s=shape, axes=axes)
    return rows.reshape(len(unit), -1)


def random_law(rng: np.random.Generator) -> InterfaceLaw:
    """Any law, from much stronger than the body to much weaker."""
    stress, length = 10 ** rng.uniform(-3, 1), 10 ** rng.uniform(-3, -0.5)
    work = stress * length
    match rng.integers(5):
        case 0:
            return Exponential(work=work, range=length).interaction()
        case 1:
            return Dugdale(work=work, stress=stress, smoothing=rng.uniform(0.05, 1)).interaction()
        case 2:
            return LennardJones(work=work, separation=length).interaction()
        case 3:
            return Electrostatic(voltage=stress**0.5, insulation=length, permittivity=2e-3).interaction()
    parts = Exponential(work=work, range=length), LennardJones(work=0.1 * work, separation=0.3 * length)
    return total([part.interaction() for part in parts])


def random_problems(seed: int) -> Iterator[tuple[Problem, tuple[int, ...]]]:
    """Three steps of one body and one punch, under depths or loads that differ by any amount."""
    rng = np.random.default_rng(seed)
    shape = SURFACE if rng.random() < 0.3 else LINE
    grid = Grid(shape, (1.0,) * len(shape))
    q, n = np.ravel(grid.wavenumbers), int(np.prod(shape))
    E, x = 10 ** rng.uniform(-1, 1), q * 10 ** rng.uniform(-2, 1)
    with np.errstate(all="ignore"):
        kappa = [
            E * q,  # halfspace
            E * np.where(x > 0, q / np.tanh(x), q[1] / x[1]),  # compressible layer on a rigid base
            E * q * (1e-3 + np.tanh(x) ** 2),  # stiff layer on a soft base
            E * np.where(x > 0, q * (1 + 1 / x**2), 0),  # thin incompressible layer
        ][rng.integers(4)]
    squares = np.ravel(sum(axis**2 for axis in np.meshgrid(*grid.coordinates, indexing="ij")))
    heights = [
        10 ** rng.uniform(-1, 1) * squares,
        10 ** rng.uniform(-3, -1) * rng.normal(size=n),
        0.01 * np.cumsum(rng.normal(size=n)),
    ][rng.integers(3)]
    h, law, loaded = heights - heights.min(), random_law(rng), rng.random() < 0.3
    history = rng.normal(size=n) * law.strength * rng.choice([0.0, 0.1])
    b = np.fft.rfftn(history.reshape(shape)).ravel()
    if loaded or kappa[0] == 0:
        kappa, b = kappa.copy(), b.copy()
        kappa[0] = b[0] = 0.0
    for _ in range(3):
        if loaded:
            yield problem(kappa, h, law, rng.uniform(0, 1) * law.strength, b), shape
        else:
            yield problem(kappa, h - rng.uniform(-1, 0.9) * h.mean(), law, None, b), shape


def least_eigenvalue(K: Floats, of: Problem, found: Solution) -> float:
    """Least curvature of the energy along the free points, over the largest of the interface."""
    curvature = of.interface.curvature(found.gap)
    pressed = (found.gap <= 0) & (of.wall_pressure(found.pressure, found.gap) > 0)
    hessian = (K + np.diag(curvature))[np.ix_(~pressed, ~pressed)]
    free = len(hessian)
    if of.mean_is_fixed and free:  # displacements of zero sum
        basis = np.linalg.qr(np.c_[np.ones(free), np.eye(free)[:, 1:]])[0][:, 1:]
        hessian = basis.T @ hessian @ basis
    scale = np.abs(of.interface.curvature(np.linspace(0, 4 * of.interface.range, 400))).max()
    return float(np.linalg.eigvalsh(hessian)[0] / scale) if len(hessian) else 0.0


def test_a_minimum_is_found_in_each_of_a_thousand_random_problems() -> None:
    tolerance, count = 1e-6, 0
    for seed in range(334):
        start, K = None, None
        for each, shape in random_problems(seed):
            solver = Newton(TRANSFORMS[shape], tolerance)
            start = at_rest(each.obstacle.size) if start is None else start
            K = dense(each.stiffness, shape) if K is None else K
            found = solver.solve(each, start)
            start = found.gap
            # The residual, from K as a matrix. Its own scales are at least the strength and at most the range.
            assert found.converged, seed
            history = np.fft.irfftn(
                each.intercept.reshape(TRANSFORMS[shape].spectral_shape), s=shape, axes=range(len(shape))
            )
            force = history.ravel() - K @ found.displacement
            pressure = force + (found.pressure - force).mean()
            wall, law = each.wall_pressure(pressure, found.gap), each.interface
            np.testing.assert_allclose(pressure, found.pressure, atol=1e-9 * law.strength)
            scale = max(law.strength, wall.max())
            assert np.abs(np.minimum(wall / scale, found.gap / law.range)).max() <= 2 * tolerance, seed
            # Near the end of a branch a residual t leaves u uncertain by sqrt(2 t) of the range.
            assert least_eigenvalue(K, each, found) >= -np.sqrt(2 * tolerance), seed
            count += 1
    assert count > 1000
