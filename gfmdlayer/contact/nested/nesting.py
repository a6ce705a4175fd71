"""First guess from coarser grids: the problem solved on the coarsest, then on each finer one from there.

Problems come from truncated Fourier series of the gap and of the stiffness, pressures by `coarser.prolong`.
"""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray
from gfmdlayer.contact.nested import passes
from gfmdlayer.contact.nested.coarser import prolong
from gfmdlayer.contact.nested.iteration import Search
from gfmdlayer.contact.nested.level import Fields, Level
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

_TOLERANCE = 1e-3
_LIMIT = 60  # iterations on a coarser grid


def nest(fine: Level, transforms: Transforms, problem: Problem, at: Fields) -> float:
    """Write the pressure of a first guess.

    Parameters
    ----------
    fine : Level
        The given grid.
    transforms : Transforms
        Its transforms in double precision.
    problem : Problem
        The problem.
    at : Fields
        Whose pressure is written.

    Returns
    -------
    float
        Pairs of transforms in single precision, as parts of those of the given grid.
    """
    surface = transforms.forward(problem.obstacle)
    free = np.zeros_like(surface)
    fine.displace(problem, free, np.empty_like(free))
    last, pairs = None, 0.0
    for grid in reversed(fine.grid.nested[1:]):
        level, state = _coarse(fine, grid, transforms, problem, (surface, free))
        state.load = None if at.load is None else at.load * grid.size / fine.grid.size
        if not _prolonged(last, level, state):
            _press(level, state)
        level.add_response(state)
        level.set_scales(state)
        Search(level, state).run(_TOLERANCE, _LIMIT)
        pairs += (level.pairs + 1) * grid.size / fine.grid.size
        last = level, state
    if not _prolonged(last, fine, at):
        if at.load is not None:  # its place holds the gap of a guess, if anything
            at.gap0[:] = problem.obstacle - transforms.backward(free) / fine.grid.size
        _press(fine, at)
    return pairs


def _coarse(
    fine: Level,
    grid: Grid,
    transforms: Transforms,
    problem: Problem,
    spectra: tuple[ComplexArray, ComplexArray],
) -> tuple[Level, Fields]:
    """The problem on a coarser grid: punch, gap without pressure, and stiffness."""
    coarse = transforms.of_shape(grid.points, single=True)
    level = Level(grid, coarse, transforms.truncated(problem.stiffness, coarse), fine.floor)
    h, free = (
        coarse.backward(transforms.truncated(each, coarse)).astype(np.float64) / fine.grid.size
        for each in spectra
    )
    return level, Fields(h, h - free, np.zeros_like(h), np.zeros_like(h), None)


def _prolonged(last: tuple[Level, Fields] | None, level: Level, at: Fields) -> bool:
    """Write the pressure of a coarser grid, of the given load; return whether there is any."""
    if last is None:
        return False
    prolong(*last, level, at.p)
    return level.set_load(at)


def _press(level: Level, at: Fields) -> None:
    """Write a first pressure where the punch lies lowest, of the given load."""
    sums = level.grid.sums
    lowest, mean = sums.minimum(float(at.gap0.min())), sums.mean(at.gap0)
    # Where the load is given, half way up to the mean height.
    height = 0.0 if at.load is None else 0.5 * (lowest + mean)
    level.sweep.only(passes.press, height, level.stiffest, at.gap0, at.p)
    if not level.set_load(at) and at.load is not None:
        at.p[:] = at.load / level.grid.size  # the punch lies equally low everywhere
