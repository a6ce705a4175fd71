"""The transforms against numpy's, and the bits that they give in any process."""

import os
import subprocess
import sys

import numba as nb
import numpy as np
import pytest

from gfmdlayer.grid.fftw import threads_for
from gfmdlayer.grid.transforms import BY_BLOCKS, Transforms, _of_c, backward, forward

SHAPES = [(8,), (9,), (1024,), (1155,), (6, 8), (5, 9), (6, 9), (7, 8), (32, 64)]


def rounding(shape):
    """Relative 2-norm error of a fast transform: a few roundings for each of its log2 n levels."""
    return float(4 * np.finfo(float).eps * np.log2(np.prod(shape)))


def fields(shape):
    return np.random.default_rng(3).standard_normal(shape)


@pytest.mark.parametrize("shape", [*SHAPES, (512,), (24, 40)])
def test_forward_is_numpys_and_backward_multiplies_it_by_the_number_of_points(shape):
    transforms, u = Transforms(shape), fields(shape)
    exact, spectrum = np.fft.rfftn(u), transforms.forward(u)
    assert np.linalg.norm(spectrum - exact.ravel()) <= rounding(shape) * np.linalg.norm(exact)
    before = spectrum.copy()
    back = transforms.backward(spectrum) / u.size
    assert np.linalg.norm(back - u.ravel()) <= 2 * rounding(shape) * np.linalg.norm(u)
    np.testing.assert_array_equal(spectrum, before)  # backward leaves the caller's spectrum alone


# Prints a digest of transforms and of a run, where FFTW may have measured plans for the same shapes before.
BITS = """
import hashlib, sys
import numpy as np
from gfmdlayer import Config, simulate
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.results.recording import Recording
shapes = [(1024,), (15015,), (48, 64), (640, 512)]
if "measured" in sys.argv:
    import pyfftw
    for shape in (48, 64), (1024,):
        for kind in "float64", "float32":
            field = pyfftw.empty_aligned(shape, kind)
            pyfftw.builders.rfftn(field, planner_effort="FFTW_MEASURE")
            Transforms((shape[0] // 2 + 1,)).forward(np.ones(shape[0] // 2 + 1))
found = hashlib.sha256()
for shape in shapes:
    for single in False, True:
        transforms = Transforms(shape, single=single)
        spectrum = transforms.forward(np.random.default_rng(3).standard_normal(shape))
        found.update(spectrum.tobytes() + transforms.backward(spectrum).tobytes())
for method in "nested_gradient", "active_set":
    run = Recording()
    values = {"grid": {"points": 256}, "time": {"end": 0.2, "step": 0.1}, "solver": {"method": method}}
    simulate(Config.model_validate({"name": "bits", **values}), run)
    found.update(np.array([run[name] for name in sorted(run.widths)]).tobytes())
print(found.hexdigest())
"""


@pytest.mark.parametrize("times", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_bits_depend_on_no_other_process_and_on_nothing_that_was_planned_before(times, tmp_path):
    """Processes with caches of their own, every second of which measures plans by FFTW itself."""
    found = [
        subprocess.run(
            [sys.executable, "-c", BITS, *before],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / str(number))},
            capture_output=True, text=True, check=True,
        ).stdout
        for number, before in enumerate((["none"], ["measured"]) * times)
    ]  # fmt: skip
    assert len(set(found)) == 1


@pytest.mark.parametrize("shape", [(1024, 512), (1023, 517), (8192, 40)])
@pytest.mark.parametrize("single", [False, True])
def test_large_surfaces_are_transformed_by_blocks_of_columns_like_small_ones(shape, single):
    """From Python and from nopython code; there is a last, narrower block."""
    transforms, u = Transforms(shape, single=single), fields(shape)
    assert transforms.size > BY_BLOCKS
    bound = 1e-6 if single else 1e-15
    exact, spectrum = np.fft.rfftn(u).ravel(), transforms.forward(u)
    assert np.abs(spectrum - exact).max() < bound * np.abs(exact).max()
    field, waves, back = transforms.empty_field(), transforms.empty_spectrum(), transforms.empty_field()
    field[:] = u.ravel()
    there_and_back(transforms.plans, field, waves, back)
    np.testing.assert_array_equal(back, transforms.backward(spectrum))
    assert np.abs(back / u.size - u.ravel()).max() < 10 * bound


@nb.njit
def there_and_back(plans, field, spectrum, back):
    forward(plans, field, spectrum)
    backward(plans, spectrum, back)


def test_functions_of_transforms_by_blocks_come_from_the_cache_of_kernels():
    """Compiled anew they take half a second of each process, and of each rank."""
    _of_c()  # which compiles them, if no process has
    assert [function.cache_hits for function in _of_c.__wrapped__()] == [1, 1]


def test_large_surfaces_take_two_threads_where_none_are_asked_for(monkeypatch):
    monkeypatch.setattr("gfmdlayer.grid.fftw.cores", lambda: frozenset(range(8)))
    found = {
        shape: threads_for(shape, None) for shape in ((1 << 22,), (2047, 2048), (2048, 2048), (4096, 1024))
    }
    assert [*found.values()] == [1, 1, 2, 2]
    assert threads_for((4096, 4096), 1) == 1
    assert threads_for((64, 64), 4) == 4  # which transforms of less than 512 x 512 points do not use
    monkeypatch.setattr("gfmdlayer.grid.fftw.cores", lambda: frozenset({3}))
    assert threads_for((2048, 2048), None) == 1


@pytest.mark.parametrize("shape", [(512, 512), (513, 511), (768, 512)])
def test_threads_change_a_transform_by_rounding_only(shape):
    u = fields(shape)
    one, two = Transforms(shape), Transforms(shape, threads=2)
    spectrum = one.forward(u)
    # log2(n) butterflies of a rounding each, on values that add up to n^(1/2).
    bound = 20 * np.finfo(float).eps
    np.testing.assert_allclose(two.forward(u), spectrum, atol=bound * np.abs(spectrum).max())
    np.testing.assert_allclose(two.backward(spectrum) / u.size, u.ravel(), atol=bound * np.abs(u).max())


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("shape", [(1024,), (7, 9), (48, 36), (20, 64), (520, 512)])
def test_a_filter_multiplies_the_modes_of_a_field(shape, single):
    """Columns go through buffers of 16, by copies above 512 x 512 points; the last ones are fewer."""
    transforms, u = Transforms(shape, single=single), fields(shape)
    factors = np.random.default_rng(4).uniform(0.5, 1.0, np.prod(transforms.spectral_shape))
    field, target = transforms.empty_field(), transforms.empty_field()
    field[:] = u.ravel()
    transforms.filter(factors.astype(field.dtype))(field, target)
    modes = np.fft.rfftn(u) * factors.reshape(transforms.spectral_shape)
    exact = np.fft.irfftn(modes, shape, axes=range(len(shape))).ravel() * u.size
    eps = np.finfo(field.dtype).eps / np.finfo(float).eps
    assert np.linalg.norm(target - exact) <= 2 * eps * rounding(shape) * np.linalg.norm(exact)
    np.testing.assert_array_equal(field, u.ravel().astype(field.dtype))
