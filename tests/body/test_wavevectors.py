"""Wavevectors: components and magnitudes of the waves of a grid, or of plain magnitudes."""

from __future__ import annotations

import numpy as np
import pytest

from gfmdlayer import Layer, LayeredHalfspace, LayerStack, ViscoelasticLayer, Wavevectors, Zener
from gfmdlayer.body.body import Body
from gfmdlayer.grid.grid import Grid

LAYER = ViscoelasticLayer(LayeredHalfspace(0.1, 0.4, 2.0), Zener())
STACK = LayerStack((Layer(0.1, 0.4, Zener()), Layer(0.2, 0.5, Zener(tau=3.0))), rigid=True)


@pytest.mark.parametrize("grid", [Grid((9,), (2.0,)), Grid((8, 6), (1.0, 3.0))])
def test_the_grid_gives_the_wavevector_of_each_mode(grid: Grid) -> None:
    waves = grid.waves
    assert waves.qx.shape == waves.qy.shape == waves.magnitude.shape == waves.shape == grid.spectral_shape
    np.testing.assert_array_equal(waves.magnitude, grid.wavenumbers)
    np.testing.assert_allclose(np.hypot(waves.qx, waves.qy), waves.magnitude, rtol=1e-15)
    # A wave exp(i q.x) on the grid has its transform at its own mode.
    wave = np.unravel_index(3, grid.spectral_shape)
    points = np.meshgrid(*grid.coordinates, indexing="ij")
    phase = sum(q[wave] * x for q, x in zip((waves.qx, waves.qy), points, strict=False))
    assert np.unravel_index(np.abs(np.fft.rfftn(np.cos(phase))).argmax(), grid.spectral_shape) == wave


def test_plain_magnitudes_are_waves_along_x() -> None:
    waves = Wavevectors.of([[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(waves.qx, [[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(waves.qy, 0.0)
    assert Wavevectors.of(waves) is waves
    assert np.shape(waves) == (2, 2)
    np.testing.assert_array_equal(2 * np.asarray(waves), 2 * waves.magnitude)


@pytest.mark.parametrize("body", [LAYER, STACK])
def test_isotropic_bodies_answer_to_the_magnitude(body: Body) -> None:
    grid = Grid((8, 6), (1.0, 3.0))
    found, expected = body.spectrum(grid.waves), body.spectrum(grid.wavenumbers)
    for name in ("relaxed", "weights", "times"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(body.stiffness(grid.waves, 1j), body.stiffness(grid.wavenumbers, 1j))
