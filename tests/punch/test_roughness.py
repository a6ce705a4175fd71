"""Self-affine surfaces: their spectrum, their rms, and that the grid does not change them."""

import numpy as np
import pytest

from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.punch.shape import Cell

SHAPES = [(128,), (129,), (64, 64), (63, 64), (64, 63), (65, 67)]
shapes = pytest.mark.parametrize("points", SHAPES, ids=lambda points: "x".join(map(str, points)))


def period(points):
    return (1.5, 1.0)[: len(points)]


def surface(points, seed=3, **keys):
    keys = {"hurst": 0.7, "short_cutoff": 0.06, "rms_height": 0.01} | keys
    return SelfAffine(seed=seed, **keys).heights(Grid(points, period(points)))


def waves(heights):
    """Wavenumbers and amplitudes of all waves, both halves of the spectrum, referred to the cell's corner."""
    steps = [
        2 * np.pi * np.fft.fftfreq(n, length / n)
        for n, length in zip(heights.shape, period(heights.shape), strict=True)
    ]
    q = np.sqrt(sum(x**2 for x in np.meshgrid(*steps, indexing="ij", sparse=True)))
    return np.asarray(q), np.asarray(np.fft.fftn(heights) / heights.size)


@shapes
def test_the_rms_height_and_slope_are_those_asked(points):
    assert surface(points, rms_height=0.02).std() == pytest.approx(0.02, rel=1e-12)
    rough = SelfAffine(hurst=0.7, short_cutoff=0.06, seed=3, rms_slope=0.1)
    heights = rough.heights(Grid(points, period(points)))
    q, amplitude = waves(heights)
    assert np.sqrt(np.sum(np.abs(q * amplitude) ** 2)) == pytest.approx(0.1, rel=1e-12)
    assert heights.min() == 0


@shapes
def test_the_spectrum_falls_as_the_hurst_exponent_says_between_its_cut_offs(points):
    q, amplitude = waves(surface(points, roll_off=0.3, long_cutoff=0.8))
    power, inside = np.abs(amplitude) ** 2, (q >= 2 * np.pi / 0.8) & (q <= 2 * np.pi / 0.06)
    flat, falling = inside & (q < 2 * np.pi / 0.3), inside & (q >= 2 * np.pi / 0.3)
    assert flat.sum() > 1
    assert falling.sum() > 20
    expected = (q[falling] * 0.3 / (2 * np.pi)) ** -(2 * 0.7 + len(points))
    np.testing.assert_allclose(power[falling] / power[flat][0], expected, rtol=1e-9)
    np.testing.assert_allclose(power[flat], power[flat][0], rtol=1e-9)
    assert (power[~inside & (q > 0)] < 1e-25 * power[flat][0]).all()


@pytest.mark.parametrize(
    ("coarse", "fine"), [((64,), (128,)), ((54, 44), (108, 88)), ((53, 41), (159, 123)), ((64, 48), (64, 96))]
)
def test_a_finer_grid_samples_the_same_surface(coarse, fine):
    every = tuple(slice(None, None, m // n) for n, m in zip(coarse, fine, strict=True))
    a, b = surface(coarse, hurst=0.9), surface(fine, hurst=0.9)[every]
    # The grids count from the same corner; only the lowest point between the coarse ones may lie lower.
    np.testing.assert_allclose(a - a.mean(), b - b.mean(), atol=1e-14)


def test_a_shorter_cut_off_adds_waves_and_leaves_the_others_their_phases():
    q, rough = waves(surface((96, 96), short_cutoff=0.05))
    _, smooth = waves(surface((96, 96), short_cutoff=0.2))
    both = (q > 0) & (q < 2 * np.pi / 0.2)
    ratio = rough[both] / smooth[both]
    np.testing.assert_allclose(ratio, ratio[0].real, rtol=1e-9)  # one scale, that of the rms, no phase
    assert 0 < ratio[0].real < 1


def test_the_phases_are_uniform_and_follow_from_the_seed():
    q, amplitude = waves(surface((128, 128), short_cutoff=0.03))
    half = (q > 0) & (np.abs(amplitude) > 1e-12)
    half[:, 65:] = False
    half[65:, 0] = False
    turns = np.exp(1j * np.angle(amplitude[half]))
    # The mean of N random directions is N^(-1/2) long; five times that is one chance in e^25.
    for harmonic in (1, 2, 3):
        assert abs(np.mean(turns**harmonic)) < 5 * half.sum() ** -0.5
    assert abs(np.mean(turns[1:] * turns[:-1].conj())) < 5 * half.sum() ** -0.5
    one, other, again = surface((64, 64), seed=1), surface((64, 64), seed=2), surface((64, 64), seed=1)
    np.testing.assert_array_equal(one, again)
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.5


def test_a_wave_that_the_grid_does_not_resolve_is_refused():
    rough = SelfAffine(hurst=0.7, short_cutoff=0.06, seed=3, rms_height=0.01)
    (problem,) = rough.misfits(Cell((48,), (1.5,)))
    assert str(problem) == "short_cutoff: got 0.06; must be > 0.0625, two spacings of the grid"
    assert not list(rough.misfits(Cell((64,), (1.5,))))
    with pytest.raises(TableError, match="no wave of the cell"):
        surface((64,), short_cutoff=0.31, long_cutoff=0.32)
