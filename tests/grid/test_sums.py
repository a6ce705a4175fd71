"""Sums over the grid: Parseval's weights, and a grid that is divided between several holders."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import numpy as np
import pytest

from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Prony
from gfmdlayer.body.relaxation import Spectrum, relaxation_spectrum
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import Ranks
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.error_control import ErrorControl
from gfmdlayer.history.modes import Modes, exponential
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.time_functions import Constant

EPS = np.finfo(float).eps


@pytest.mark.parametrize("shape", [(16,), (15,), (8, 6), (7, 9)])
def test_spectral_means_are_means_over_the_surface(shape: tuple[int, ...]) -> None:
    grid, rng = Grid(shape, (1.0,) * len(shape)), np.random.default_rng(2)
    fields = rng.standard_normal((3, *shape))
    v, f, g = (np.fft.rfftn(field).ravel() for field in fields)
    expected = [(fields[0] * other).mean() for other in (fields[1], fields[2], fields[0])]
    np.testing.assert_allclose(grid.sums.spectral_means(v, f, g), expected, atol=40 * EPS)
    assert grid.sums.spectral_mean(v, f) == pytest.approx(expected[0], abs=40 * EPS)
    assert grid.sums.mean(fields[0]) == pytest.approx(fields[0].mean(), abs=EPS)


class Divided(Ranks):
    """Holders of a grid, each of them in a thread."""

    def __init__(self, rank: int, values: list[Any], barrier: Barrier) -> None:
        self._rank, self._values, self._barrier = rank, values, barrier

    def _all(self, partial: Any) -> list[Any]:
        self._values[self._rank] = partial
        self._barrier.wait(timeout=300)
        values = list(self._values)
        self._barrier.wait(timeout=300)
        return values

    def total(self, partial: Any) -> Any:
        return sum(self._all(partial))

    def maximum(self, partial: Any) -> Any:
        return np.max(self._all(partial), axis=0)

    def minimum(self, partial: Any) -> Any:
        return np.min(self._all(partial), axis=0)


@pytest.mark.parametrize("velocity", [None, 0.4])
def test_modes_on_a_divided_grid_have_the_energy_and_the_error_of_the_whole(velocity: float | None) -> None:
    grid, rng = Grid((32,), (1.0,)), np.random.default_rng(4)
    body, material = LayeredHalfspace(0.1, 0.4, 2.0), Prony(1.0, ((2.0, 0.1), (3.0, 1.0)))
    q, size = grid.wavenumbers, grid.wavenumbers.size
    spectrum = relaxation_spectrum(body, material, q)
    displacements = (rng.standard_normal((4, size)) + 1j * rng.standard_normal((4, size))) / (1 + q)

    def numbers(waves: slice, sums: Sums) -> list[float]:
        mine = Spectrum(spectrum.relaxed[waves], spectrum.weights[:, waves], spectrum.times[:, waves])
        modes: Any = Modes(mine, exponential, sums)
        if velocity is not None:
            motion = {"wavenumbers_x": grid.wavenumbers_x[:, waves], "velocity": Constant(velocity)}
            modes = SlidingModes(mine, sums, **motion)
        control = ErrorControl(modes, sums, 1e-4)
        found = [modes.shortest_time, *([modes.slowest(1e-3)] if velocity else [])]
        for step, u in zip((0.0, 0.05, 0.1, 0.2), displacements, strict=True):
            control.terms(step)
            if step:
                found += control.error(u[waves], moving=True, deep=True)
            control.advance(np.ascontiguousarray(u[waves]))
            found += [modes.stored, modes.dissipated]
        return found

    values, barrier = [None, None], Barrier(2)
    halves = slice(0, 7), slice(7, size)  # of different size
    weights = grid.parseval_weights
    divided = [Sums(weights[waves], Divided(i, values, barrier)) for i, waves in enumerate(halves)]
    with ThreadPoolExecutor(2) as threads:
        parts = list(threads.map(numbers, halves, divided))
    assert parts[0] == parts[1]
    # Sums of some tens of terms of the size of the stored energy, in another order.
    whole = numbers(slice(None), grid.sums)
    np.testing.assert_allclose(parts[0], whole, rtol=1e-11)
