"""The paper's default case, bare FFT pairs, ratios of times."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.config import Config, load
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.model import simulate, warm_up
from gfmdlayer.verification.runs import Recording

METHODS = ("active_set", "conjugate_gradient", "fire")
STEP = 0.005  # the paper's, in tau
_DEFAULT = Path(__file__).parents[2] / "configs" / "indentation.yaml"


def default_case(**values: object) -> Config:
    """Return the paper's default case with other values; two underscores replace the dot of a key."""
    return load(_DEFAULT).with_values({key.replace("__", "."): value for key, value in values.items()})


def run(config: Config) -> Recording:
    """Simulate a case in memory, after compilation and planning."""
    recording = Recording()
    simulate(config, recording, wisdom=warm_up(config))
    return recording


def bare_pairs(transforms: Transforms, count: int) -> Callable[[], None]:
    """Return a compiled task of `count` FFT pairs."""
    field, back, spectrum = transforms.empty_field(), transforms.empty_field(), transforms.empty_spectrum()
    field[:] = np.cos(np.arange(field.size))
    _pairs(transforms.plans, field, spectrum, back, 1)
    return lambda: _pairs(transforms.plans, field, spectrum, back, count)


def ratio(whole: Callable[[], object], part: Callable[[], object], repetitions: int) -> float:
    """Return the median ratio of the times of two tasks that run in turns."""
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
