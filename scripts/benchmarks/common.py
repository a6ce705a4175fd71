"""What the sections share: the paper's default case, a recorder in memory, and the bare FFT pairs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.config import Config, load
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.simulation import simulate, warm_up

METHODS = ("active_set", "conjugate_gradient", "fire")
STEP = 0.005  # the paper's, in tau
_DEFAULT = Path(__file__).parents[2] / "configs" / "indentation.yaml"


def default_case(**values: object) -> Config:
    """Return the paper's default case with some values changed; a double underscore stands for the dot."""
    return load(_DEFAULT).with_values({key.replace("__", "."): value for key, value in values.items()})


class Trace:
    """Keeps in memory what a simulation finds."""

    def __init__(self) -> None:
        self._rows: list[dict[str, float]] = []

    def row(self, **values: float) -> None:
        """Take the observables of an accepted step."""
        self._rows.append(values)

    def snapshot(self, time: float, displacement: FloatArray, pressure: FloatArray) -> None:
        """Leave the surface aside."""

    def __getitem__(self, name: str) -> FloatArray:
        """Return an observable over the time points, the first at t = 0."""
        return np.array([row[name] for row in self._rows])


def run(config: Config) -> Trace:
    """Simulate a case into memory, with everything compiled and planned beforehand."""
    trace = Trace()
    simulate(config, trace, wisdom=warm_up(config))
    return trace


def bare_pairs(transforms: Transforms, count: int) -> Callable[[], None]:
    """Return a task that does FFT pairs and nothing else, in compiled code."""
    field, back, spectrum = transforms.empty_field(), transforms.empty_field(), transforms.empty_spectrum()
    field[:] = np.cos(np.arange(field.size))
    _pairs(transforms.plans, field, spectrum, back, 1)
    return lambda: _pairs(transforms.plans, field, spectrum, back, count)


def ratio(whole: Callable[[], object], part: Callable[[], object], repetitions: int) -> float:
    """Return the time of the whole over that of the part: the median over repetitions in turns."""
    return float(np.median([seconds(whole) / seconds(part) for _ in range(repetitions)]))


def seconds(task: Callable[[], object]) -> float:
    """Return the wall time of a task."""
    begun = time.perf_counter()
    task()
    return time.perf_counter() - begun


@nb.njit(nogil=True, cache=True)
def _pairs(plans: Plans, field: FloatArray, spectrum: ComplexArray, back: FloatArray, count: int) -> None:
    for _ in range(count):
        forward(plans, field, spectrum)
        backward(plans, spectrum, back)
