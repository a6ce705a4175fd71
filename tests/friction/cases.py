"""Random steps of frictional contact."""

import numpy as np

from gfmdlayer.friction.problem import FrictionProblem
from gfmdlayer.friction.response import Response
from gfmdlayer.grid.grid import Grid
from gfmdlayer.interface.friction import ShearBound


def halfspace(grid, modulus, poisson):
    """Response of an elastic halfspace of fixed mean displacement."""
    q = grid.wavenumbers
    unit = np.divide(1, modulus * q, out=np.zeros(q.shape), where=q > 0)
    return Response((1 - poisson) * unit, 0.5 * (1 - 2 * poisson) * unit, (1 - poisson) * unit, unit)


def rough(grid, random, hurst):
    """Self-affine heights of rms 1."""
    axes = tuple(range(len(grid.points)))
    q = grid.wavenumbers
    size = np.where(q > 0, np.maximum(q, 1e-9) ** -(hurst + len(axes) / 2), 0.0)
    noise = np.fft.rfftn(random.standard_normal(grid.points), axes=axes)
    field = np.fft.irfftn(noise * size, s=grid.points, axes=axes).ravel()
    return np.asarray(field / field.std())


def random_problem(seed, axes):
    """Return a step on a halfspace, by the numbers of a generator."""
    r = np.random.default_rng(seed)
    n = int(r.integers(32, 129)) * 2 if axes == 1 else 32
    grid = Grid((n,) * axes, (1.0,) * axes)
    nu, mu, kind = r.uniform(0, 0.5), r.uniform(0, 2), r.integers(3)
    if kind == 0:
        h = rough(grid, r, r.uniform(0.3, 1)) * 0.01
    elif kind == 1:
        h = r.standard_normal(grid.size) * 0.01
    else:
        squares = sum(x**2 for x in np.meshgrid(*grid.coordinates, indexing="ij"))
        h = np.asarray(squares).ravel() / r.uniform(0.2, 2)
    h -= h.min()
    offset = np.zeros((1 + axes, grid.size))
    for component in offset[1:]:
        smooth = r.random() < 0.7
        component[:] = rough(grid, r, 0.8) * 10 ** r.uniform(-4, -1.5) if smooth else (
            r.standard_normal(grid.size) * 10 ** r.uniform(-5, -2)
        )  # fmt: skip
    load = 10 ** r.uniform(-3, -1)
    load_is_given, force_is_given = r.random() < 0.5, r.random() < 0.5
    n = r.standard_normal(axes)
    force = r.uniform(-0.95, 0.95) * mu * load * n / np.linalg.norm(n)
    path = r.standard_normal(axes) * 10 ** r.uniform(-4, -1.5)
    depth = float(h.mean()) * 10 ** r.uniform(-1, 0)
    return grid, FrictionProblem(
        halfspace(grid, 1.0, nu), h, ShearBound(mu),
        load=load if load_is_given or force_is_given else None, depth=depth,
        force=force if force_is_given else None, path=None if force_is_given else path, offset=offset,
    )  # fmt: skip
