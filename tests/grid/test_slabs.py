"""A surface over ranks: transforms, sums and halos agree with those of one process."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Prony
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import Ranks
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.errors import ErrorControl, NormalMeans
from gfmdlayer.history.modes import Modes, exponential
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.time_functions import Constant

MPIRUN = Path(sys.executable).parent / "mpirun"

# On three ranks, and grids that they do not divide. Transforms of numbers below one are exact to
# eps log2(n) of the largest value, some 1e-15.
CHECKS = """
import numba as nb
import numpy as np
from mpi4py import MPI
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import MpiRanks
from gfmdlayer.grid.slabs import SlabTransforms
from gfmdlayer.grid.slabs import SlabGrid
from gfmdlayer.grid.transforms import Transforms, backward, forward

ranks = MpiRanks(MPI.COMM_WORLD)

@nb.njit
def there_and_back(plans, field, spectrum, found):
    forward(plans, field, spectrum)
    backward(plans, spectrum, found)

for points in ((20, 30), (17, 25), (13, 32)):
    whole, grid = Grid(points, (2.0, 3.0)), SlabGrid(points, (2.0, 3.0), members=ranks)
    field = np.random.default_rng(1).random(points)
    spectrum = np.fft.rfftn(field)
    own, waves = field[grid.rows], spectrum[:, grid.columns]
    assert (own.shape, waves.shape) == (grid.shape, grid.spectral_shape)
    assert grid.size == field.size
    for name in ("wavenumbers", "wavenumbers_x", "parseval_weights"):
        assert (getattr(grid, name) == getattr(whole, name)[..., grid.columns]).all(), name
    assert (grid.coordinates[0] == whole.coordinates[0][grid.rows]).all()
    for shared in (True, False):
        transforms = SlabTransforms(grid, shared=shared)
        found = transforms.forward(own)
        assert abs(found - waves.ravel()).max() < 1e-14 * abs(spectrum).max()
        assert abs(transforms.backward(waves) / field.size - own.ravel()).max() < 1e-14
        back = transforms.empty_field()
        source = transforms.empty_field()
        source[:] = own.ravel()
        there_and_back(transforms.plans, source, transforms.empty_spectrum(), back)
        assert abs(back / field.size - own.ravel()).max() < 1e-14
        single = transforms.of_shape(points, single=True)
        assert abs(single.forward(own) - waves.ravel()).max() < 1e-6 * abs(spectrum).max()
        coarse = SlabGrid((points[0] // 2, points[1] // 2), (2.0, 3.0), members=ranks)
        those = Transforms(points).truncated(spectrum.ravel(), Transforms(coarse.points))
        these = transforms.truncated(waves.ravel(), transforms.of_shape(coarse.points))
        width = coarse.points[1] // 2 + 1
        assert (these == those.reshape(-1, width)[:, coarse.columns].ravel()).all()
        again = SlabTransforms(grid, shared=shared)
        assert (again.forward(own) == found).all()
    assert abs(grid.from_waves(waves.copy()) - own).max() < 1e-14

    sums = grid.sums
    assert abs(sums.mean(own) - field.mean()) < 1e-15
    every = MPI.COMM_WORLD.allgather(sums.mean(own))
    assert len(set(every)) == 1
    assert abs(sums.spectral_mean(waves.ravel(), waves.ravel()) - (field**2).mean()) < 1e-15
    assert sums.maximum(float(own.max())) == field.max()
    assert (sums.minimum(own.min(axis=0)) == field.min(axis=0)).all()
    assert ranks.mean_wave(waves.ravel()) == spectrum[0, 0]
    at = np.arange(points[0])[grid.rows]
    for before, after in ((2, 2), (1, 3), (points[0], points[0])):  # the last from every rank, round about
        above, below = grid.halo(own, before, after)
        assert (above == field[(at[0] - np.arange(before, 0, -1)) % points[0]]).all()
        assert (below == field[(at[-1] + 1 + np.arange(after)) % points[0]]).all()
        assert all(map(np.array_equal, whole.halo(field, before, after),
                       (field[-np.arange(before, 0, -1) % points[0]], field[np.arange(after) % points[0]])))
for points, words in (((64,), "a line"), ((64, 8), "at most 2 ranks")):
    try:
        SlabGrid(points, (1.0,) * len(points), members=ranks)
    except ValueError as error:
        assert words in str(error), error
    else:
        raise AssertionError(points)
if ranks.first:
    print("all agree")
"""


def test_a_grid_over_ranks_has_the_numbers_of_one_process():
    command = [str(MPIRUN), "-n", "3", sys.executable, "-m", "mpi4py", "-c", CHECKS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout == "all agree\n", done.stderr


# --- sums: Parseval's weights, and a grid that is divided between several holders ---

EPS = np.finfo(float).eps


@pytest.mark.parametrize("shape", [(16,), (15,), (8, 6), (7, 9)])
def test_spectral_means_are_means_over_the_surface(shape):
    grid, rng = Grid(shape, (1.0,) * len(shape)), np.random.default_rng(2)
    fields = rng.standard_normal((3, *shape))
    v, f, g = (np.fft.rfftn(field).ravel() for field in fields)
    expected = [(fields[0] * other).mean() for other in (fields[1], fields[2], fields[0])]
    np.testing.assert_allclose(grid.sums.spectral_means(v, f, g), expected, atol=40 * EPS)
    assert grid.sums.spectral_mean(v, f) == pytest.approx(expected[0], abs=40 * EPS)
    assert grid.sums.mean(fields[0]) == pytest.approx(fields[0].mean(), abs=EPS)


class Divided(Ranks):
    """Holders of a grid, each of them in a thread."""

    def __init__(self, rank, values, barrier):
        self._rank, self._values, self._barrier, self.count = rank, values, barrier, len(values)

    def _all(self, partial):
        self._values[self._rank] = partial
        self._barrier.wait(timeout=300)
        values = list(self._values)
        self._barrier.wait(timeout=300)
        return values

    def total(self, partial):
        return sum(self._all(partial))

    def maximum(self, partial):
        return np.max(self._all(partial), axis=0)

    def minimum(self, partial):
        return np.min(self._all(partial), axis=0)


@pytest.mark.parametrize("velocity", [None, 0.4])
def test_modes_on_a_divided_grid_have_the_energy_and_the_error_of_the_whole(velocity):
    grid, rng = Grid((32,), (1.0,)), np.random.default_rng(4)
    body, material = LayeredHalfspace(0.1, 0.4, 2.0), Prony(1.0, ((2.0, 0.1), (3.0, 1.0)))
    q, size = grid.wavenumbers, grid.wavenumbers.size
    spectrum = relaxation_spectrum(body, material, q)
    displacements = (rng.standard_normal((4, size)) + 1j * rng.standard_normal((4, size))) / (1 + q)

    def numbers(waves, sums):
        mine = Spectrum(spectrum.relaxed[waves], spectrum.weights[:, waves], spectrum.times[:, waves])
        modes = Modes(mine, exponential, sums)
        if velocity is not None:
            motion = {"wavenumbers_x": grid.wavenumbers_x[:, waves], "velocity": Constant(velocity)}
            modes = SlidingModes(mine, sums, **motion)
        control = ErrorControl(modes, NormalMeans(modes, sums))
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
